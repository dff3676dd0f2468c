"""A wire of this machine between a port and another, which can be pulled out."""

import socket
from contextlib import contextmanager, suppress
from threading import Lock, Thread


class Cable:
    """Carries bytes between those who connect to `endpoint` and a port of this machine."""

    def __init__(self, port: int) -> None:
        self._port, self._ends, self._all, self._lock = port, [], [], Lock()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listening.getsockname()[1]}"
        self._threads = [Thread(target=self._accept)]
        self._threads[0].start()

    def _accept(self) -> None:
        while True:
            try:
                here, _ = self._listening.accept()
            except OSError:
                return
            try:
                there = socket.create_connection(("127.0.0.1", self._port))
            except OSError:  # nobody listens there yet
                here.close()
                continue
            with self._lock:
                self._ends += [here, there]
                self._all += [here, there]
            for one, other in ((here, there), (there, here)):
                self._threads.append(Thread(target=self._carry, args=(one, other)))
                self._threads[-1].start()

    def _carry(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(65536):
                other.sendall(data)
        for end in (one, other):
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self) -> None:
        """End all that goes through it; what connects afterwards is carried again."""
        with self._lock:
            ends, self._ends = self._ends, []
        for end in ends:
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Carry nothing any more."""
        self._listening.shutdown(socket.SHUT_RDWR)
        self._threads[0].join()
        self.cut()
        for thread in self._threads[1:]:
            thread.join()
        for end in (self._listening, *self._all):
            end.close()


@contextmanager
def cable_to(port: int):
    """Yield a cable to a port of this machine."""
    cable = Cable(port)
    try:
        yield cable
    finally:
        cable.close()
