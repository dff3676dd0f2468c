"""A session is opened only where there is room for it: Zenoh panics or hangs where there is none.

What it needs is taken for a moment and given back, since no limit says how much of it is left.
"""

import mmap
import os
from contextlib import ExitStack
from threading import Event, Thread

from nrs_cosim.bus.errors import BusError

DESCRIPTORS, THREADS, ADDRESSES = 16, 16, 512 * 2**20
"""How many a session on a network may take; threads reserve addresses for stacks and heaps."""


def expect_room() -> None:
    """Raise `BusError` where this process may not have what a session takes."""
    done, threads = Event(), list[Thread]()
    what, limit = f"{DESCRIPTORS} more file descriptors", "-n"
    try:
        with ExitStack() as stack:
            for _ in range(DESCRIPTORS):
                stack.callback(os.close, os.open(os.devnull, os.O_RDONLY))
        what, limit = f"{ADDRESSES // 2**20} MiB more of addresses", "-v"
        mmap.mmap(-1, ADDRESSES, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=mmap.PROT_READ).close()
        what, limit = f"{THREADS} more threads", "-u"
        # They wait for one another: only threads that are there together show that there is room.
        for _ in range(THREADS):
            thread = Thread(target=done.wait)
            thread.start()
            threads.append(thread)
    except (OSError, RuntimeError, MemoryError) as error:
        why = getattr(error, "strerror", None) or str(error) or "out of memory"
        raise BusError(
            f"no session could be opened: this process may not have {what} ({why}); raise the "
            f"limit: `ulimit {limit}`, or the container's or the cluster's own"
        ) from None
    finally:
        done.set()
        for thread in threads:
            thread.join()
