"""A wire in user space, for kernels without netem: packets from one TUN device to the other.

    python -m tests.network.relay LEFT DEVICE RIGHT DEVICE DELAY_MS LOSS_PERCENT

Each packet is lost or delayed on its way; which are lost is drawn from a seed, in the order in
which they come. It prints a line once both devices are there, and ends with its standard input.
"""

import ctypes
import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque
from pathlib import Path

TUNSETIFF, IFF_TUN, IFF_NO_PI, CLONE_NEWNET = 0x400454CA, 0x0001, 0x1000, 0x40000000
LONGEST_PACKET = 65536


def device_in(namespace: str, name: str) -> int:
    """Return the descriptor of a TUN device that is made in a namespace."""
    libc = ctypes.CDLL(None, use_errno=True)
    with Path("/run/netns", namespace).open("rb") as place:
        if libc.setns(place.fileno(), CLONE_NEWNET):
            raise OSError(ctypes.get_errno(), f"cannot enter {namespace}")
    device = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TUN | IFF_NO_PI))
    return device


def relay(ends: tuple[int, int], delay: float, loss: float) -> None:
    """Carry packets until the standard input closes; delay in s, loss as a share."""
    other = dict(zip(ends, reversed(ends), strict=True))
    draw = random.Random(1).random
    under_way: deque[tuple[float, int, bytes]] = deque()
    while True:
        wait = max(0.0, under_way[0][0] - time.monotonic()) if under_way else None
        ready, _, _ = select.select([*ends, 0], [], [], wait)
        if 0 in ready:
            return
        now = time.monotonic()
        for end in ready:
            packet = os.read(end, LONGEST_PACKET)
            if draw() >= loss:
                under_way.append((now + delay, other[end], packet))
        while under_way and under_way[0][0] <= now:
            _, end, packet = under_way.popleft()
            try:
                os.write(end, packet)
            except OSError:  # the device is down: the wire is cut
                continue


if __name__ == "__main__":
    left, left_device, right, right_device, delay_ms, loss_percent = sys.argv[1:]
    both = device_in(left, left_device), device_in(right, right_device)
    print("joined", flush=True)
    relay(both, float(delay_ms) / 1000, float(loss_percent) / 100)
