"""What a recording says of its run is read once, and is what it should be or is refused by name.

The seals of a file say that it is as its writer left it, not that the writer was a run: anybody can
make them. So each record is a model, and what can be compared is: the robots of `nrs.run` with the
topics that there are, and its plants with its robots.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    Json,
    RootModel,
    ValidationError,
    ValidationInfo,
    field_validator,
)

from nrs_cosim.bus.errors import Cause
from nrs_cosim.bus.numerals import whole
from nrs_cosim.bus.text import quoted
from nrs_cosim.bus.topics import Topics
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.container import Closing

RUN = "nrs.run"
"""The metadata record that describes the run: seed, robots, joints, ticks, periods, plants."""
VERSIONS = "nrs.versions"
SPENT, REJECTED, CAUSE, SAMPLES = "spent", "rejected", "cause", "samples"
"""What is said at the end, as JSON: where wall time went, what was rejected, and what ended the
run early."""
MEASURED = "measured"
"""Is said at the end of a run that came to it, as JSON: the steady state that was measured."""
THEORY = "theory"
"""Is said at the end of a run that came to it, as JSON: what was measured beside the theory."""
LINKS = "links"
"""Is said at the end of a run that has link events, as JSON: how many samples met what."""
PARENT = "nrs.parent"
"""The metadata record of a recording that came from another by a change."""
SCENARIO = "scenario.toml"
"""The attachment that holds the scenario's text."""
ASSETS = "nrs.assets"
"""The metadata record of what the scenario names and is attached beside it, by field."""
URDFS = "nrs.urdfs"
"""The metadata record of the attachments that are URDFs: the robots that each is of, as JSON."""

MOST_JOINTS = 2**20
"""More than any robot has; a message of so many is 40 MiB."""
_SHOWN = 60
"""Characters of a wrong value."""

_Model = TypeVar("_Model", bound=BaseModel)
_Root = TypeVar("_Root")
Whole = Annotated[int, BeforeValidator(lambda text: whole(text) if isinstance(text, str) else text)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Words = Annotated[str, Field(pattern=r"^[^\x00]*$")]


class _Record(BaseModel):
    """A record; keys that are not known are a later version's."""

    model_config = ConfigDict(frozen=True, extra="allow", defer_build=True)


class JointRecord(_Record):
    """A joint's name, and the unit of its coordinate: rad, m, or empty where none is known."""

    name: str
    unit: Literal["rad", "m", ""]


class PlantGroup(_Record):
    """Robots whose plants are of one FMU, and driven the same way."""

    fmu: Words
    name: str
    fmi_version: str
    kind: str
    drive: str
    why: str
    any_machine: bool | None = None
    """Whether all machines come to the same bits, as by no other tool's FMU nor by CVODE."""
    sha256: Sha256
    robots: Annotated[tuple[int, ...], Field(min_length=1)]
    joints: tuple[JointRecord, ...]


class RunRecord(_Record):
    """`nrs.run`."""

    name: str
    folder: Words
    seed: Annotated[Whole, Field(ge=0)]
    robots: Annotated[Whole, Field(ge=1)]
    joints: Annotated[Whole, Field(ge=1, le=MOST_JOINTS)]
    ticks: Annotated[Whole, Field(ge=0)]
    sampling_period_ns: Annotated[Whole, Field(ge=1)] | None = None
    """None of a run whose sampling times are not periodic."""
    output_step_ns: Annotated[Whole, Field(ge=1)] | None = None
    outputs_per_interval: Annotated[Whole, Field(ge=1)] | None = None
    plants: Annotated[Json[tuple[PlantGroup, ...]], Field(min_length=1)]


class Parent(_Record):
    """`nrs.parent`."""

    digest: Sha256
    change: str


class AssetRecord(_Record):
    """What a field of the scenario names, and which attachment has it."""

    name: Words
    """What the scenario calls it."""
    attachment: str
    """Its name."""
    sha256: Sha256
    """Of the attachment."""
    source_sha256: Sha256
    """Of the file that it was made from."""


class _ByName(RootModel[_Root]):
    """A record whose keys are names."""

    model_config = ConfigDict(defer_build=True)


class AssetRecords(_ByName[dict[str, Json[AssetRecord]]]):
    """`nrs.assets`."""


class UrdfRecords(_ByName[dict[str, Json[tuple[int, ...]]]]):
    """`nrs.urdfs`."""


_Measured = Annotated[FiniteFloat, Field(ge=0)]
_Moment = Annotated[int, Field(ge=0)]


class MeasuredRecord(_Record):
    """What was measured of the last fifth; see `recordings.measurement.SteadyState`."""

    position_estimate: _Measured | None
    velocity_estimate: _Measured | None
    position_tracking: _Measured | None
    velocity_tracking: _Measured | None
    times_ns: tuple[_Moment, _Moment, _Moment, _Moment]
    size: _Measured


_Count = Annotated[int, Field(ge=0, lt=2**63)]


class LinkRecord(_Record):
    """How many samples met what on links; see `recordings.link_counts`."""

    lost: _Count
    outage: _Count
    late: _Count
    duplicated: _Count
    altered: _Count
    latest: _Count
    """By how many sampling periods the latest was late."""
    silent: dict[Annotated[int, Field(ge=1)], tuple[_Count, _Count, Annotated[_Count, Field(ge=1)]]]
    """Of each robot that was in an outage its first and last tick there, and how many it had."""


class EndRecord(_Record):
    """`nrs.end`."""

    status: Closing
    reason: str
    digest: Sha256
    ticks: Annotated[Whole, Field(ge=0)]
    messages: Annotated[Whole, Field(ge=0)]
    cause: Json[Cause] | None = None
    """What ended it before its last tick."""
    spent: Json[dict[str, dict[str, FiniteFloat]]] | None = None
    part_of: Annotated[str, Field(pattern=r"^([0-9a-f]{64})?$")] | None = None
    """Of what was recovered: the digest of all of the run, empty if unknown."""
    rejected: Json[dict[str, Annotated[int, Field(ge=0)]]] | None = None
    measured: Json[MeasuredRecord] | None = None
    theory: Json[dict[str, Any]] | None = None
    """See `recordings.theory_record`; one of another version has another form."""
    links: Json[LinkRecord] | None = None
    samples: Annotated[Whole, Field(ge=0)] | None = None
    """How many of the messages are samples of robots."""

    @field_validator("samples")
    @classmethod
    def _of_messages(cls, samples: int | None, info: ValidationInfo) -> int | None:
        messages = info.data.get("messages", 0)
        if samples is not None and samples > messages:
            raise ValueError(f"expected no more than the {messages} messages")
        return samples


@dataclass(frozen=True, slots=True)
class About:
    """All that a recording says of its run before the first message."""

    run: RunRecord
    versions: Mapping[str, str]
    parent: Parent | None
    scenario: str
    """The text of the scenario."""
    assets: Mapping[str, AssetRecord]
    """By the field of the scenario that names each."""
    urdfs: Mapping[int, bytes]
    """Of each robot of which one is known."""

    @property
    def is_former(self) -> bool:
        """Whether it was made when libraries' mathematics were in what is recorded."""
        return all(group.any_machine is None for group in self.run.plants)

    @property
    def plants(self) -> list[dict[str, Any]]:
        """What is told of the plants, by group, for JSON."""
        return [group.model_dump(mode="json") for group in self.run.plants]


def read_about(
    path: object,
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Mapping[str, tuple[str, bytes]],
    topics: Collection[str],
) -> About | None:
    """Return what records say of a run, None if there is none; `UnreadableError` names a field.

    `topics` are those whose messages enter the digest; some robots may have measurements.
    """
    if RUN not in metadata:
        return None
    run = parse(path, RUN, RunRecord, metadata[RUN])
    n = run.robots
    of_plants = sorted(robot for group in run.plants for robot in group.robots)
    # No more is made than the file has.
    names, robots = Topics.among(topics, n), range(1, min(n, len(of_plants)) + 1)
    topics = {*topics}.difference(names.all_of("measurement", robots))
    kinds = ("sample", "state", "agent_state")
    of_each = [kinds[:count] for count in (0, 2, 3) if len(topics) == count * names.shared + 1]
    expected = {names.of("sample", 0)}.union(
        *(names.all_of(kind, robots) for kinds in of_each for kind in kinds)
    )
    if expected != topics or len(robots) < n:
        raise _wrong(path, f"{RUN}: robots", f"as many as there are topics of, got {n}")
    if of_plants != [*robots]:
        raise _wrong(path, f"{RUN}: plants", f"each of the {n} robots once, got {of_plants}")
    if (run.sampling_period_ns is None) != (run.output_step_ns is None) or (
        run.sampling_period_ns is None
    ) != (run.outputs_per_interval is not None):
        times = "sampling_period_ns and output_step_ns, or outputs_per_interval"
        raise _wrong(path, RUN, f"{times}, got {', '.join(metadata[RUN])}")
    if VERSIONS not in metadata:
        raise _wrong(path, VERSIONS, "this record, got none")
    if SCENARIO not in attachments:
        raise _wrong(path, SCENARIO, "this attachment, got none")
    try:
        scenario = attachments[SCENARIO][1].decode()
    except UnicodeDecodeError as error:
        raise _wrong(path, SCENARIO, f"text in UTF-8, got none: {error}") from None
    parent = parse(path, PARENT, Parent, metadata[PARENT]) if PARENT in metadata else None
    assets = parse(path, ASSETS, AssetRecords, metadata.get(ASSETS, {})).root
    for field, asset in assets.items():
        if asset.attachment not in attachments:
            raise _wrong(path, asset.attachment, f"this attachment, which is {field}'s, got none")
        got = sha256(attachments[asset.attachment][1]).hexdigest()
        if got != asset.sha256:
            raise _wrong(
                path,
                asset.attachment,
                f"the content that {field} had, of SHA-256 {asset.sha256[:16]}…, got {got[:16]}…",
            )
    urdfs = _urdfs(path, metadata.get(URDFS, {}), attachments, n)
    return About(run, metadata[VERSIONS], parent, scenario, assets, urdfs)


def _urdfs(
    path: object,
    record: Mapping[str, str],
    attachments: Mapping[str, tuple[str, bytes]],
    n: int,
) -> dict[int, bytes]:
    found: dict[int, bytes] = {}
    for name, robots in parse(path, URDFS, UrdfRecords, record).root.items():
        if name not in attachments:
            raise _wrong(path, name, f"this attachment, which {URDFS} names, got none")
        content = attachments[name][1]
        if name != f"{(got := sha256(content).hexdigest())}.urdf":
            raise _wrong(path, name, f"the content of that SHA-256, got {got[:16]}…")
        for robot in robots:
            if robot in found or not 1 <= robot <= n:
                raise _wrong(path, f"{URDFS}: {name}", f"robots of the {n}, once, got {robot}")
            found[robot] = content
    return found


def parse(path: object, name: str, model: type[_Model], fields: Mapping[str, str]) -> _Model:
    """Return a record by its model; `UnreadableError` names the first field that is wrong."""
    try:
        return model.model_validate(fields)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_context=False)[0]
        if fault["type"] == "missing":
            field = ".".join(map(str, fault["loc"]))
            raise _wrong(path, f"{name}: {field}", "this field, got none") from None
        field, *inner = map(str, fault["loc"])
        what = fault["msg"][0].lower() + fault["msg"][1:]
        raise UnreadableError(
            f"{path}: {name}: {'.'.join([field, *inner])}: {what}, got "
            f"{quoted(fault['input'])}{_ADVICE}"
        ) from None


_ADVICE = "; it is not as a run wrote it: use another copy, or run the scenario again"


def _wrong(path: object, field: str, expected: str) -> UnreadableError:
    shown = expected if len(expected) <= 2 * _SHOWN else f"{expected[: 2 * _SHOWN]}…"
    return UnreadableError(f"{path}: {field}: expected {shown}{_ADVICE}")
