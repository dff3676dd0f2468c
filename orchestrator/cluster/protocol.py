"""What workers and the orchestrator write to each other beside samples, as JSON.

A worker asks to be let in (`Hello`, `Welcome` or `Refusal`), opens its robots, says so (`Ready`)
and is told to begin (`Go`); at its end, or when it fails, it says how that was (`Report`). All but
the first two steps are signed. Those cannot be; but a `Welcome`, which holds the
run's secret, is encrypted to a key of which the `Hello` has the public half alone: whoever repeats
a `Hello` gets nothing that it can read. Where anyone may speak, on plain TCP, a stranger may be let
in while robots are free, and may lure a worker into a run of its own.
"""

from collections.abc import Sequence
from struct import Struct
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from nrs_cosim.bus.errors import BusError, Cause, InputError
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.orchestrator.scenario.assets import TABLE, Asset

END = b"end"
"""What ends a worker."""
TICK = Struct("<I")
"""A tick by number, in a question and in its answer."""


class NotExpectedError(Exception):
    """Somebody says what a worker in its state would not; it is counted, and not answered."""


class Note(BaseModel):
    """A note whose fields are all known."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", ser_json_bytes="hex", val_json_bytes="hex"
    )

    @classmethod
    def read(cls, data: bytes) -> Self:
        """Read one; `BusError` when it is none."""
        try:
            return cls.model_validate_json(data)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(map(str, fault["loc"]))
            raise BusError(f"no {cls.__name__}: {where}: {fault['msg']}") from None

    def written(self) -> bytes:
        """Return it as it travels."""
        return self.model_dump_json().encode()


class Hello(Note):
    """A worker wants to join."""

    version: str
    """Of nrs-cosim."""
    incarnation: str
    """Which of the workers of this name it is: the id of its session."""
    robots: tuple[int, ...] | None
    """The ones that it wants; None for any slot that is free."""
    public: bytes
    """The key that its `Welcome` is encrypted to; nobody else has the private one."""


class AssetNote(Note):
    """A table that the scenario names; FMUs are asked for by themselves, where they are needed."""

    name: str
    sha256: str
    source_sha256: str
    content: str

    @classmethod
    def of(cls, asset: Asset) -> Self:
        """Return an asset as it travels."""
        return cls(
            name=asset.name,
            sha256=asset.sha256,
            source_sha256=asset.source_sha256,
            content=asset.content.decode(),
        )

    def asset(self, field: str) -> Asset:
        """Return it as the orchestrator has it; `InputError` where it is another."""
        asset = Asset.of(self.name, self.source_sha256, TABLE, self.content.encode())
        if asset.sha256 != self.sha256:
            raise InputError(
                f"{field}: {self.name}: expected content of SHA-256 {self.sha256[:16]}… from the "
                f"orchestrator, got {asset.sha256[:16]}…"
            )
        return asset


class Welcome(Note):
    """A worker is let in."""

    run: str
    secret: Annotated[bytes, Field(min_length=32, max_length=32)]
    """See `bus.signature`."""
    name: str
    """The scenario's."""
    scenario: str
    """Its text."""
    assets: dict[str, AssetNote]
    """What the text names, by field."""
    folder: str | None
    """What its paths are relative to, for a worker of the same machine."""
    fmus: dict[str, str]
    """The SHA-256 of each FMU, by what the scenario calls it."""
    robots: tuple[int, ...]


class Refusal(Note):
    """A worker is not let in."""

    reason: str
    final: bool
    """Whether asking again is of no use."""
    over: bool = False
    """Whether that is because the run came to its end."""


class PlantDescription(Note):
    """What the user is told of some robots' plants; see `orchestrator.engine.robots.Robots`."""

    fmu: str
    name: str
    fmi_version: str
    kind: str
    drive: str
    why: str
    any_machine: bool
    sha256: str
    robots: tuple[int, ...]
    joints: tuple[dict[str, str], ...]
    urdf: str


class Ready(Note):
    """A worker's robots are open."""

    incarnation: str
    plants: tuple[PlantDescription, ...]
    """By group."""


class Go(Note):
    """A worker is to begin: at the tick `start`, of a recording that has those up to `recorded`."""

    assignment: dict[str, tuple[int, ...]]
    start: int
    recorded: int

    def with_checkpoints(self, checkpoints: Sequence[bytes]) -> bytes:
        """Return it as it travels, with the checkpoint of each robot at `start`."""
        return joined([self.written(), *checkpoints])

    @classmethod
    def and_checkpoints(cls, data: bytes) -> tuple[Self, list[bytes]]:
        """Read what `with_checkpoints` returned."""
        note, *checkpoints = parted(data) or [b""]  # which is no note
        return cls.read(note), checkpoints


class Report(Note):
    """How a worker ended: it is done, or failed at a tick, or could not open its robots (−1)."""

    tick: int
    failed: str | None = None
    cause: Cause | None = None
    place: tuple[int, int, int] = (0, 0, 0)
    """Where in the tick; see `orchestrator.engine.worker.Worker`."""
    plants: float = 0.0
    bus: float = 0.0
    waiting: float = 0.0
    """s of wall time."""
