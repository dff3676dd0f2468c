"""A page that is served on this machine alone, while what it shows still grows.

    GET /                       the page, which asks for
    GET /data.json?since=V      what there is: 200 with its version in X-Version, 204 if nothing new

Nothing is read unless a page asks, by one thread at a time, and reading takes a tenth of the time
at most. Only a browser that asks for this machine by its own name is answered, so that no foreign
page reads a run.
"""

import logging
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import inf
from socket import socket
from threading import BoundedSemaphore, Condition, Lock
from time import monotonic
from typing import Any
from urllib.parse import parse_qs, urlsplit

from nrs_cosim.recordings.report.page import live_page

_LOG = logging.getLogger(__name__)

HOST = "127.0.0.1"
Version = Callable[[], str]
"""Names the state of what is shown; empty as long as there is nothing."""
Tell = Callable[[], bytes | None]
"""Reads what is shown, as JSON; None when it cannot be read yet."""


MOST = 64
"""Connections at a time, each of which has a thread."""
PATIENCE = 10.0
"""s: how long a connection may be silent."""


class LiveServer(ThreadingHTTPServer):
    """Serves a page and what it shows."""

    daemon_threads = True

    def __init__(self, listening: socket, version: Version, tell: Tell) -> None:
        """Serve on a socket that listens already."""
        self._version, self._tell = version, tell
        self._free = BoundedSemaphore(MOST)
        self._reading, self._handed = Lock(), Condition()
        self._last: tuple[str, bytes] = ("", b"")
        self._rest_until = -inf
        self._seen, self._asked = "", -inf
        super().__init__(listening.getsockname(), _Answer, bind_and_activate=False)
        self.socket.close()
        self.socket = listening
        self.server_port = listening.getsockname()[1]

    def verify_request(self, request: object, client_address: object) -> bool:  # noqa: ARG002
        """Return whether there is room for another connection; one too many is closed."""
        return self._free.acquire(blocking=False)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, then make room for another."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Log why a connection ended before its answer was out, as when a tab is closed."""
        _LOG.info("%s: %s: ended early", *client_address[:2], exc_info=True)

    def news(self, since: str) -> tuple[str, bytes] | None:
        """Return the version and the JSON of what there is; None when `since` has it all."""
        self._asked = monotonic()
        with self._reading:
            now = self._version()
            if now and now != self._last[0] and monotonic() >= self._rest_until:
                began = monotonic()
                if state := self._tell():
                    self._last = now, state
                ended = monotonic()
                self._rest_until = ended + 9 * (ended - began)
            known = self._last
        return known if known[0] not in ("", since) else None

    def handed(self, version: str) -> None:
        """Note that a page has a version."""
        with self._handed:
            self._seen = version
            self._handed.notify_all()

    def linger(self, patience: float) -> None:
        """Wait for so long, s, that the page has what is there at last, if one asked as lately."""
        self._rest_until = -inf
        last = self._version()
        if monotonic() - self._asked <= patience:
            with self._handed:
                self._handed.wait_for(lambda: self._seen == last, patience)


class _Answer(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = PATIENCE
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Answer with the page, the news, or that there is nothing of the kind."""
        port = self.server.server_port
        if self.headers.get("Host") not in (f"{HOST}:{port}", f"localhost:{port}"):
            self._send(403, b"", "text/plain")
            return
        asked = urlsplit(self.path)
        if asked.path == "/":
            self._send(200, live_page().encode(), "text/html; charset=utf-8")
        elif asked.path == "/data.json":
            since = parse_qs(asked.query).get("since", [""])[0]
            news = self.server.news(since)
            if news is None:
                self._send(204, b"", "application/json")
            else:
                version, state = news
                self._send(200, state, "application/json", version)
                self.server.handed(version)
        else:
            self._send(404, b"", "text/plain")

    def _send(self, status: int, content: bytes, kind: str, version: str = "") -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        if version:
            self.send_header("X-Version", version)
        self.end_headers()
        if status != 204:
            self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002, the library's name
        """Log it: the terminal is the run's."""
        _LOG.info(format, *args)
