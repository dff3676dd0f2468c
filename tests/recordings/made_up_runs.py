"""Recordings of runs, by the real writer and of messages that are made up."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import topic_of
from nrs_cosim.bus.messages import Codec
from nrs_cosim.recordings.channels import channels, schemas
from nrs_cosim.recordings.mcap.container import Channel, Message
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.metadata import RUN
from nrs_cosim.recordings.schemas import fields_record
from tests.scenarios import tables, toml

H = 100_000_000  # ns


def chain(n: int, m: int, ticks: int) -> dict[str, Any]:
    """The tables of n robots with m joints, each of which receives from the one before it.

    The target is at rest.
    """
    return tables(
        {
            "run.duration": ticks * H / 1e9,
            "run.sampling_period": H / 1e9,
            "run.output_step": H / 2e9,
            "network": {"edge_list": [[robot - 1, robot] for robot in range(1, n + 1)]},
            "target.axes": [{"offset": 1.0}] * m,
            "disturbance": None,
            "initial": None,
        }
    )


def about(n: int, m: int, ticks: int) -> dict[str, dict[str, str]]:
    """What a run of n robots with m joints notes of itself."""
    plant = {
        "fmu": "two_link_arm",
        "name": "two_link_arm",
        "fmi_version": "3.0",
        "kind": "CoSimulation",
        "drive": "reference-driven Co-Simulation",
        "why": "",
        "sha256": "0" * 64,
        "any_machine": True,
        "robots": [*range(1, n + 1)],
        "joints": [{"name": f"joint_{j}", "unit": "rad"} for j in range(1, m + 1)],
    }
    run = {"name": "made_up", "folder": "/", "seed": 1, "robots": n, "joints": m, "ticks": ticks}
    run |= {"sampling_period_ns": H, "output_step_ns": H // 2, "plants": json.dumps([plant])}
    return {RUN: {key: str(value) for key, value in run.items()}, "nrs.versions": {"python": "3"}}


def tick(
    k: int, n: int, m: int, faulty: Sequence[int] = (), codecs: Codecs | None = None
) -> list[Message]:
    """Tick k of n robots: samples at t_k, states at the two output times, some faults."""
    rng = np.random.default_rng(k)
    codecs = codecs or Codecs.of(Sizes(m))
    samples, states, faults = codecs.samples, codecs.states, codecs.link_events
    made: list[Message] = []

    def put(codec: Codec, robots: Sequence[int], time_ns: int, kind: str) -> None:
        records = codec.blank(np.array(robots, "u4"))
        records["k"], records["time_ns"] = k, time_ns
        for name in codec.kind.fields:
            records[name] = rng.standard_normal(records[name].shape)
        if codec is faults:
            records["source"], records["lost"] = 1, 1
        payloads = zip(robots, codec.encode(records), strict=True)
        made.extend((time_ns, topic_of(kind, robot), k, data) for robot, data in payloads)

    for time_ns in (k * H - H // 2, k * H) if k else (0,):
        put(states, range(1, n + 1), time_ns, "state")
    if k:
        put(samples, range(n + 1), k * H, "sample")
        for kind, codec in codecs.of_agents.items():
            step = 2 if kind == "measurement" else 1  # every other robot is pinned
            put(codec, range(1, n + 1, step), k * H, kind)
        if faulty and k % 3 == 0:
            put(faults, faulty, k * H, "link_event")
    return made


def create(
    path: Path,
    n: int,
    m: int,
    ticks: int,
    faulty: Sequence[int],
    codecs: Codecs | None = None,
    **options: Any,
) -> Writer:
    """A writer of such a run."""
    codecs = codecs or Codecs.of(Sizes(m))
    used: list[Channel] = channels(codecs, n, faulty, False, (), range(1, n + 1, 2))
    attachments = {"scenario.toml": ("application/toml", toml(base=chain(n, m, ticks)).encode())}
    head = {
        "channels": used,
        "schemas": schemas(used, codecs),
        "metadata": {**about(n, m, ticks), **fields_record(codecs)},
    }
    return Writer(path, version="1.2", attachments=attachments, **head, **options)


def recorded(
    path: Path,
    *,
    n: int = 6,
    m: int = 2,
    ticks: int = 20,
    faulty: Sequence[int] = (),
    codecs: Codecs | None = None,
    **options: Any,
) -> list[Message]:
    """Write a completed run; return its messages in total order."""
    made = [sorted(tick(k, n, m, faulty, codecs)) for k in range(ticks + 1)]
    with create(path, n, m, ticks, faulty, codecs, **options) as writer:
        for messages in made:
            writer.write(messages)
        writer.finish("completed")
    return [message for messages in made for message in messages]
