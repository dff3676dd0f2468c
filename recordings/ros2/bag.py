"""A bag of ROS 2: an MCAP file of profile "ros2", by itself or in a folder beside `metadata.yaml`.

A chunk is written for each stretch of messages that is put, in the order of time, and of topics at
one time. The file gets its name when it is whole. The description is of version 5, which Humble and
all later releases read, in JSON, which is YAML.
"""

import json
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
from mcap import records as mcap

from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.mcap.chunk import encoded_chunk, packed
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import MAGIC, MOST_CHANNELS, closing, encoded
from nrs_cosim.recordings.ros2.definitions import RosType

PROFILE = "ros2"
_LATCHED, _VOLATILE = 1, 2
_FOREVER = {"sec": 9223372036, "nsec": 854775807}


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic; what is `latched` is for those too who listen later."""

    name: str
    type: RosType
    latched: bool = False

    @property
    def qos(self) -> str:
        """How it is offered: reliably, the last messages kept."""
        return json.dumps(
            [
                {
                    "history": 1,
                    "depth": 1 if self.latched else 10,
                    "reliability": 1,
                    "durability": _LATCHED if self.latched else _VOLATILE,
                    "deadline": _FOREVER,
                    "lifespan": _FOREVER,
                    "liveliness": 1,
                    "liveliness_lease_duration": _FOREVER,
                    "avoid_ros_namespace_conventions": False,
                }
            ]
        )


class Bag:
    """The messages of some topics, which have the numbers 1, 2, … in their order."""

    def __init__(self, file: BinaryIO, topics: Sequence[Topic], version: str) -> None:
        types = list(dict.fromkeys(topic.type for topic in topics))
        self.topics, self.counts = topics, Counter[int]()
        self.start = self.end = 0
        """ns: of the first and the last message."""
        self._file, self._offset, self._crc = file, 0, 0
        self._chunk_indexes: list[bytes] = []
        self._summary: list[mcap.McapRecord] = [
            mcap.Schema(number, one.definition.encode(), "ros2msg", one.name)
            for number, one in enumerate(types, 1)
        ]
        for number, topic in enumerate(topics, 1):
            about = {"offered_qos_profiles": topic.qos, "topic_type_hash": topic.type.hash}
            schema = types.index(topic.type) + 1
            self._summary.append(mcap.Channel(number, topic.name, "cdr", about, schema))
        header = mcap.Header(PROFILE, f"nrs-cosim {version}")
        self._emit(MAGIC + encoded(header, *self._summary))

    def put(self, messages: Columns) -> None:
        """Write messages in their order, none of which is earlier than one that was put before."""
        if not self._chunk_indexes:
            self.start = int(messages.time[0])
        self.end = int(messages.time[-1])
        numbers, counts = np.unique(messages.channel, return_counts=True)
        self.counts.update(dict(zip(numbers.tolist(), counts.tolist(), strict=True)))
        chunk, index = encoded_chunk(self._offset, packed(messages), "zstd")
        self._chunk_indexes.append(index)
        self._emit(chunk)

    def finish(self) -> None:
        """Write what stands behind the messages."""
        statistics = mcap.Statistics(
            attachment_count=0,
            channel_count=0,
            channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunk_indexes),
            message_count=self.counts.total(),
            message_end_time=self.end,
            message_start_time=self.start,
            metadata_count=0,
            schema_count=0,
        )
        self._emit(
            closing(
                offset=self._offset,
                crc=self._crc,
                summary=self._summary,
                statistics=statistics,
                chunk_indexes=self._chunk_indexes,
            )
        )

    def _emit(self, data: bytes) -> None:
        self._file.write(data)
        self._offset += len(data)
        self._crc = zlib.crc32(data, self._crc)


@contextmanager
def new_bag(output: Path, topics: Sequence[Topic], version: str) -> Iterator[Bag]:
    """Yield a bag that is `output` once all is in it: a file `….mcap`, or else a folder.

    `UncreatableError` where it cannot be written, or has more topics than a file has room for.
    """
    if len(topics) > MOST_CHANNELS:
        raise UncreatableError(
            f"{output}: would have {len(topics)} topics, and a file has room for {MOST_CHANNELS}; "
            "take some of the robots (--robots)"
        )
    alone = output.suffix.lower() == ".mcap"
    path = output if alone else output / f"{output.name}_0.mcap"
    part = path.with_suffix(".part")
    is_new = not path.parent.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with part.open("wb") as file:
                bag = Bag(file, topics, version)
                yield bag
                bag.finish()
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
            if is_new and not any(path.parent.iterdir()):
                path.parent.rmdir()
        if not alone:
            (output / "metadata.yaml").write_text(_description(bag, path.name), "utf-8")
    except OSError as error:
        raise UncreatableError(f"{output}: cannot be written: {error.strerror}") from None


def _description(bag: Bag, file: str) -> str:
    """Return what `metadata.yaml` says of a bag."""
    times = {
        "duration": {"nanoseconds": bag.end - bag.start},
        "starting_time": {"nanoseconds_since_epoch": bag.start},
        "message_count": bag.counts.total(),
    }
    topics = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type.name,
                "serialization_format": "cdr",
                "offered_qos_profiles": topic.qos,
            },
            "message_count": bag.counts[number],
        }
        for number, topic in enumerate(bag.topics, 1)
    ]
    about = {
        "version": 5,
        "storage_identifier": "mcap",
        **times,
        "topics_with_message_count": topics,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file],
        "files": [{"path": file, **times}],
    }
    return json.dumps({"rosbag2_bagfile_information": about}, indent=1) + "\n"
