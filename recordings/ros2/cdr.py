"""Messages of ROS 2 in CDR: little-endian, each number at a multiple of its size (XCDR1).

All messages of one topic are alike but for some numbers. So a message is written once with zeros,
a template that knows where these numbers stand, and any number of messages are copies of templates
into which columns of numbers are put.
"""

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.mcap.columns import put_rows, windows

_HEAD = b"\0\1\0\0"
"""CDR, little-endian; alignment counts from behind it."""
STAMP = np.dtype([("sec", "<i4"), ("nanosec", "<u4")])
LATEST_NS = 2**31 * 10**9
"""Where stamps end."""


class Template:
    """A message under construction, and where its numbers will stand."""

    def __init__(self) -> None:
        self.data = bytearray(_HEAD)
        self.places: dict[str, list[int]] = {}

    def text(self, text: str) -> Self:
        """Add a string."""
        utf8 = text.encode() + b"\0"
        self.count(len(utf8)).data += utf8
        return self

    def texts(self, texts: Sequence[str]) -> Self:
        """Add a sequence of strings."""
        self.count(len(texts))
        for text in texts:
            self.text(text)
        return self

    def count(self, number: int) -> Self:
        """Add a number of 32 bits."""
        self._align(4).data += struct.pack("<I", number)
        return self

    def byte(self, number: int) -> Self:
        """Add a number of 8 bits."""
        self.data.append(number)
        return self

    def stamp(self) -> Self:
        """Leave room for a time."""
        return self._room("stamp", 4, STAMP.itemsize)

    def doubles(self, name: str, number: int) -> Self:
        """Leave room for some numbers of 64 bits."""
        return self._room(name, 8, 8 * number)

    def sequence(self, name: str, number: int) -> Self:
        """Leave room for a sequence of some numbers of 64 bits, at least one."""
        return self.count(number).doubles(name, number)

    def _room(self, name: str, step: int, size: int) -> Self:
        self.places.setdefault(name, []).append(len(self._align(step).data))
        self.data += bytes(size)
        return self

    def _align(self, step: int) -> Self:
        self.data += bytes(-(len(self.data) - len(_HEAD)) % step)
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Templates:
    """Templates that have the same numbers, each wherever it has them."""

    data: bytes
    starts: NDArray[np.int64]
    """(templates,) in `data`."""
    sizes: NDArray[np.int64]
    places: Mapping[str, NDArray[np.int64]]
    """(templates, times that there are such numbers), from a message's own beginning."""

    @classmethod
    def of(cls, templates: Sequence[Template]) -> Self:
        """Return some templates, at least one."""
        sizes = np.array([len(one.data) for one in templates])
        names = templates[0].places
        return cls(
            b"".join(bytes(one.data) for one in templates),
            np.cumsum(sizes) - sizes,
            sizes,
            {name: np.array([one.places[name] for one in templates]) for name in names},
        )

    def filled(
        self, which: NDArray[np.intp], numbers: Mapping[str, NDArray[Any]]
    ) -> tuple[memoryview, NDArray[np.int64], NDArray[np.int64]]:
        """Return messages, one after the other, and where each begins and ends.

        `which` (messages,) are their templates; numbers are (messages, …, numbers of a place), or
        stamps (messages,), which all places of a message share.
        """
        sizes = self.sizes[which]
        stops = np.cumsum(sizes)
        starts = stops - sizes
        data = np.empty(int(stops[-1]) if len(stops) else 0, np.uint8).data
        put_rows(data, starts, self.data, self.starts[which], sizes)
        for name, values in numbers.items():
            at = starts[:, np.newaxis] + self.places[name][which]
            size = values.dtype.itemsize * (1 if values.dtype == STAMP else values.shape[-1])
            found = np.ascontiguousarray(values).view(f"V{size}")
            windows(data, size)[at] = found.reshape(len(which), -1)
        return data, starts, stops


def stamps(time_ns: NDArray[np.int64]) -> NDArray[np.void]:
    """Return times as stamps."""
    found = np.empty(len(time_ns), STAMP)
    found["sec"], found["nanosec"] = np.divmod(time_ns, 10**9)
    return found


def joint_state(frame: str, names: Sequence[str], *, effort: bool) -> Template:
    """Return a `sensor_msgs/msg/JointState` of joints by their names."""
    template, m = Template().stamp().text(frame).texts(names), len(names)
    template.sequence("position", m).sequence("velocity", m)
    return template.sequence("effort", m) if effort else template.count(0)


def transforms(frames: Sequence[tuple[str, str]]) -> Template:
    """Return a `tf2_msgs/msg/TFMessage` of parent and child frames; `frame` has seven numbers."""
    template = Template().count(len(frames))
    for parent, child in frames:
        template.stamp().text(parent).text(child).doubles("frame", 7)
    return template


def string(text: str) -> Template:
    """Return a `std_msgs/msg/String`."""
    return Template().text(text)


def log(level: int, name: str, text: str) -> Template:
    """Return an `rcl_interfaces/msg/Log`."""
    return Template().stamp().byte(level).text(name).text(text).text("").text("").count(0)
