"""A scenario is data: a TOML file, parsed once into frozen values of known types and shapes.

Each class below is a table of the file, and its fields are the keys that the table may have.
n is the number of robots and m the number of the target's axes.
"""

from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from estimator_agents.hearing import Missing

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Weight = Annotated[Number, Field(ge=0)]
Count = Annotated[int, Field(strict=True, ge=0)]
Tick = Annotated[int, Field(strict=True, ge=1)]
MOST_ROBOTS = 100_000
Node = Annotated[int, Field(strict=True, ge=0, le=MOST_ROBOTS)]
RobotNumber = Annotated[int, Field(strict=True, ge=1, le=MOST_ROBOTS)]
Text = Annotated[str, Field(strict=True)]
Vector = tuple[Number, ...]
Matrix = tuple[Vector, ...]


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(frozen=True, extra="forbid")


NUMBER, TRUTH, TEXT = "a number", "true or false", "a text"
VECTOR, MATRIX = "a list of numbers", "a list of lists of numbers"
VALUES, ROWS, NAMES = "a list", "a list of lists", "a list of names"
DRAW, PATTERN = "{uniform = [low, high]}", "{pattern = …, base = …}"
PERIODS, PAIR = "a whole number", "{position = …, velocity = …}"
HARMONIC, SAMPLED, MOVING = "a harmonic target", "a sampled target", "an FMU as target"
EDGE, WEIGHTED = "[source, sink]", "[source, sink, weight]"
FORMS = frozenset(
    {NUMBER, TRUTH, TEXT, VECTOR, MATRIX, VALUES, ROWS, NAMES, DRAW, PATTERN, PERIODS, PAIR}
    | {HARMONIC, SAMPLED, MOVING, EDGE, WEIGHTED}
)


def _form(value: Any) -> str:
    """Return which form of a value was written, so that its errors speak of that form alone."""
    if isinstance(value, dict | Uniform):
        return DRAW
    if not isinstance(value, list | tuple):
        return NUMBER
    return MATRIX if any(isinstance(row, list | tuple) for row in value) else VECTOR


def _parameter_form(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ROWS if any(isinstance(row, list | tuple) for row in value) else VALUES
    return {bool: TRUTH, str: TEXT}.get(type(value), NUMBER)


def _name_form(value: Any) -> str:
    if isinstance(value, dict | Pattern):
        return PATTERN
    return NAMES if isinstance(value, list | tuple) else TEXT


def _indexed(pattern: str) -> str:
    if "{i}" not in pattern:
        raise ValueError("a name with {i} for the index, and {j} for a second one")
    return pattern


class Uniform(Table):
    """A seeded draw of every component."""

    uniform: tuple[Number, Number] = Field(description="[low, high)")


def _not_empty(names: tuple[str, ...]) -> tuple[str, ...]:
    if not names:
        raise ValueError("at least one name")
    return names


def _whole_or(value: Any, number: ValidatorFunctionWrapHandler) -> float | int:
    """Leave a whole number what it is, for an FMU may ask for one."""
    return value if type(value) is int else number(value)


class Pattern(Table):
    """Names that are alike but for an index: joint1.phi, joint2.phi, …"""

    pattern: Annotated[str, AfterValidator(_indexed)] = Field(
        description="a name with {i} for the index, and {j} for a second one"
    )
    base: Literal[0, 1] = Field(1, description="what the index counts from")


Gain = Annotated[
    Annotated[Number, Tag(NUMBER)]
    | Annotated[Vector, Tag(VECTOR)]
    | Annotated[Matrix, Tag(MATRIX)],
    Discriminator(_form),
]
InitialRows = Annotated[
    Annotated[Uniform, Tag(DRAW)] | Annotated[Matrix, Tag(MATRIX)], Discriminator(_form)
]
InitialRow = Annotated[
    Annotated[Uniform, Tag(DRAW)] | Annotated[Vector, Tag(VECTOR)], Discriminator(_form)
]
Exact = Annotated[Number, WrapValidator(_whole_or)]
Entry = Annotated[
    Annotated[Exact, Tag(NUMBER)] | Annotated[bool, Tag(TRUTH)] | Annotated[Text, Tag(TEXT)],
    Discriminator(_parameter_form),
]
Parameter = Annotated[
    Annotated[Exact, Tag(NUMBER)]
    | Annotated[bool, Tag(TRUTH)]
    | Annotated[Text, Tag(TEXT)]
    | Annotated[tuple[Entry, ...], Tag(VALUES)]
    | Annotated[tuple[tuple[Entry, ...], ...], Tag(ROWS)],
    Discriminator(_parameter_form),
]
Name = Annotated[
    Annotated[Text, Tag(TEXT)]
    | Annotated[tuple[Text, ...], AfterValidator(_not_empty), Tag(NAMES)]
    | Annotated[Pattern, Tag(PATTERN)],
    Discriminator(_name_form),
]


class Run(Table):
    """How long, how often, and from which seed."""

    duration: Positive | None = Field(
        None,
        description="s; a whole number of sampling periods, or of turns of sampling_times, which "
        "is one by default",
    )
    sampling_period: Positive | None = Field(
        None, description="s; h of the paper, whole nanoseconds"
    )
    sampling_jitter: Annotated[Number, Field(ge=0, lt=1)] = Field(
        0.0,
        description="a part of sampling_period: each sampling time is early by up to so much, "
        "drawn from the seed",
    )
    sampling_times: tuple[Positive, ...] = Field(
        (),
        description="s; t_1, t_2, … in place of sampling_period, increasing, whole nanoseconds; "
        "repeated up to the duration",
    )
    output_step: Positive | None = Field(
        None,
        description="s; divides sampling_period, which it is by default; with sampling_times the "
        "longest, of which each interval has as many as the longest one",
    )
    seed: Count = Field(0, description="of all that is drawn")
    divergence_limit: Positive = Field(
        1e5, description="rad, rad/s; the run fails when an estimate or a state is beyond it"
    )
    checkpoint_every: Count = Field(
        500, description="ticks between checkpoints, from which robots can be restored; 0 for none"
    )

    @property
    def end(self) -> float | None:
        """The duration, s; None where nothing tells it."""
        return self.duration or (self.sampling_times[-1] if self.sampling_times else None)


class AlgorithmChoice(Table):
    """The estimator and its gains."""

    name: str = Field(description="dcea1, dcea2, or the name of an installed plug-in")
    alpha: Positive = Field(description="gain on the positions")
    beta: Positive = Field(description="gain on the velocities")
    missing: Missing | None = Field(
        None,
        description="without a neighbour's sample an agent goes by the last one (hold), or without "
        "that neighbour (drop); by default the first that the algorithm knows",
    )


class Controller(Table):
    """tau = kp (position_i − q) + kd (velocity_i − qd)."""

    kp: Gain = Field(description="N m/rad: a number, m numbers, or m x m")
    kd: Gain = Field(description="N m s/rad: a number, m numbers, or m x m")


def _edge_form(value: Any) -> str:
    known = {2: EDGE, 3: WEIGHTED}
    return known.get(len(value), "") if isinstance(value, list | tuple) else ""


Edge = tuple[Node, RobotNumber] | tuple[Node, RobotNumber, Positive]
EdgeEntry = Annotated[
    Annotated[tuple[Node, RobotNumber], Tag(EDGE)]
    | Annotated[tuple[Node, RobotNumber, Positive], Tag(WEIGHTED)],
    Discriminator(_edge_form),
]


class Generator(Table):
    """A network by rule, drawn from run.seed where it is random."""

    kind: Literal["ring", "path", "star", "random_k_in", "small_world"] = Field(
        description="ring: i hears i-1, and 1 hears n; path: the same, but that 1 hears no robot; "
        "star: all hear robot 1; random_k_in: each hears k others; small_world: k neighbours on "
        "each side, both ways, some of them rewired"
    )
    n: RobotNumber = Field(description="the number of robots")
    k: Annotated[int, Field(strict=True, ge=1)] | None = Field(
        None, description="of random_k_in and small_world, which must have it"
    )
    rewire: Annotated[Number, Field(ge=0, le=1)] | None = Field(
        None,
        description="of small_world: the probability that an edge beyond the nearest "
        "neighbours goes elsewhere; 0.1 by default",
    )
    pinned: tuple[RobotNumber, ...] = Field(
        (1,), min_length=1, description="the robots that hear the target"
    )
    weight: Positive = Field(1.0, description="of every edge")


class Digraph(Table):
    """Who hears whom, in one of these forms: adjacency with pinning, or one of the others."""

    adjacency: tuple[tuple[Weight, ...], ...] | None = Field(
        None, min_length=1, description="n x n; [i][j] > 0: robot i+1 hears robot j+1"
    )
    pinning: tuple[Weight, ...] | None = Field(
        None, description="n; [i] > 0: robot i+1 hears the target"
    )
    generator: Generator | None = None
    edge_list: tuple[EdgeEntry, ...] | None = Field(
        None,
        min_length=1,
        description="[source, sink] or [source, sink, weight], where sink "
        "hears source; 0 is the target, n the largest number; the weight is 1 unless given",
    )
    edges: Text | None = Field(
        None, description="path of a CSV file relative to this file: source,sink[,weight]"
    )
    graphml: Text | None = Field(
        None, description="path of a GraphML file relative to this file, whose nodes are 0 to n"
    )

    @property
    def forms(self) -> list[str]:
        """The forms that are given, where there must be one."""
        forms = ("adjacency", "generator", "edge_list", "edges", "graphml")
        given = [form for form in forms if getattr(self, form) is not None]
        dense = self.pinning is not None and self.adjacency is None
        return [*(["pinning"] if dense else []), *given]

    @cached_property
    def n(self) -> int:
        """The number of robots."""
        if self.generator:
            return self.generator.n
        if self.edge_list:
            return max(max(edge[:2]) for edge in self.edge_list)
        return len(self.adjacency or ())


class Exchange(Digraph):
    """Who hears whom: one digraph, or one for positions and one for velocities."""

    position: Digraph | None = Field(None, description="over which positions travel")
    velocity: Digraph | None = Field(None, description="over which velocities travel")

    @property
    def forms(self) -> list[str]:
        """The forms that are given, where there must be one."""
        apart = [name for name in ("position", "velocity") if getattr(self, name) is not None]
        return [*super().forms, *(["position"] if len(apart) == 2 else apart)]

    @cached_property
    def n(self) -> int:
        """The number of robots."""
        return self.position.n if self.position else super().n


class Turn(Exchange):
    """Who hears whom from a tick on."""

    from_: Tick = Field(alias="from", description="the first tick of it, k; 1 in the first entry")


class Network(Exchange):
    """Who hears whom, always the same or by turns."""

    switching: tuple[Turn, ...] | None = Field(
        None, min_length=1, description="networks in turn, each from a tick to the next one's"
    )
    repeat: Tick | None = Field(
        None, description="ticks after which the turns come again; by default the last one stays"
    )

    @property
    def forms(self) -> list[str]:
        """The forms that are given, where there must be one."""
        return [*super().forms, *(["switching"] if self.switching else [])]

    @cached_property
    def n(self) -> int:
        """The number of robots."""
        return self.switching[0].n if self.switching else super().n


class Wave(Table):
    """amplitude · sin or cos (frequency t + phase)."""

    amplitude: Number
    frequency: Number = Field(description="rad/s")
    phase: Number = Field(0.0, description="rad")


class Axis(Table):
    """offset + rate t + Σ sines + Σ cosines."""

    offset: Number = 0.0
    rate: Number = Field(0.0, description="per second")
    sines: tuple[Wave, ...] = ()
    cosines: tuple[Wave, ...] = ()


def _target_kind(kind: Any) -> Any:
    if kind != "harmonic":  # the others have tables of their own
        raise ValueError("'harmonic', 'sampled' or 'fmu'")
    return kind


def _target_form(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return {"sampled": SAMPLED, "fmu": MOVING}.get(str(kind), HARMONIC)


class HarmonicTarget(Table):
    """The target moves by a formula on each axis."""

    kind: Annotated[Literal["harmonic"], BeforeValidator(_target_kind)] = "harmonic"
    axes: tuple[Axis, ...] = Field(min_length=1, description="one for each of the m joints")

    @property
    def m(self) -> int:
        """The number of axes."""
        return len(self.axes)


class SampledTarget(Table):
    """The target moves along the cubic spline through what was sampled: in `file`, or given here.

    A file is read once, and `times` and `positions` of the scenario's text take its place.
    """

    kind: Literal["sampled"]
    file: str | None = Field(
        None,
        description="path relative to this file, .csv or .parquet: columns t (s) and position_1 … "
        "position_m; velocity_1 … velocity_m, where given, are checked against the spline's",
    )
    times: Vector = Field((), description="s; increasing, from 0 or before to the run's end")
    positions: tuple[Annotated[Vector, Field(min_length=1)], ...] = Field(
        (), description="one row of m numbers for each time"
    )

    @property
    def m(self) -> int:
        """The number of axes; 0 before a file is read."""
        return len(self.positions[0]) if self.positions else 0


class Fmu(Table):
    """An FMU, and what it is told."""

    fmu: str = Field(description="a bundled model, or the path of an .fmu relative to this file")
    parameters: dict[str, Parameter] = Field({}, description="of the FMU, by name, in its units")
    variables: dict[str, Name] = Field(
        {},
        description="what the FMU has for q, qd, tau …, or in a target for position and velocity, "
        "where that is not found by itself: a name, the stem of a family, a slice such as x[0:2], "
        "a list of names, or a pattern",
    )
    isolate: bool = Field(
        True, strict=True, description="run an FMU that is none of ours in a process of its own"
    )
    deadline: Positive = Field(
        10.0, description="s of wall time; an isolated FMU that takes longer for a call is ended"
    )


class FmuTarget(Fmu):
    """The target moves as an FMU does that nothing drives, by its outputs position and velocity.

    It is run once, when a scenario file is read, and what it did is then in the scenario's text.
    """

    kind: Literal["fmu"]
    step: Positive | None = Field(
        None,
        description="s; the longest between two samples of the FMU, which is sampled at all output "
        "times too; a quarter of each sampling period by default",
    )
    sha256: Text | None = Field(None, description="of the FMU that was run")
    times: Vector = Field(
        (), description="s; when it was sampled. Without the samples the FMU is run again"
    )
    positions: tuple[Vector, ...] = Field((), description="one row of m numbers for each time")
    velocities: tuple[Vector, ...] = Field((), description="one row of m numbers for each time")

    @property
    def m(self) -> int:
        """The number of axes; 0 before the FMU was run."""
        return len(self.positions[0]) if self.positions else 0


TargetMotion = Annotated[
    Annotated[HarmonicTarget, Tag(HARMONIC)]
    | Annotated[SampledTarget, Tag(SAMPLED)]
    | Annotated[FmuTarget, Tag(MOVING)],
    Discriminator(_target_form),
]
TARGETS: dict[Any, type[Table]] = {
    HARMONIC: HarmonicTarget,
    SAMPLED: SampledTarget,
    MOVING: FmuTarget,
}
"""The target's tables by form."""


class Plant(Fmu):
    """A robot's dynamics."""

    solver: Literal["cvode", "rk4"] | None = Field(
        None, description="of Model Exchange; by default the most accurate way that the FMU offers"
    )
    rtol: Annotated[Number, Field(ge=1e-13, le=1e-2)] | None = Field(
        None, description="of cvode, relative; 1e-9 by default"
    )
    step: Positive | None = Field(None, description="s; the longest of rk4, 0.005 by default")
    control: Literal["hold", "heun"] | None = Field(
        None, description="of a torque from outside, in Co-Simulation: held, or corrected once"
    )
    control_step: Positive | None = Field(
        None, description="s; the longest for which a torque is held, 0.005 by default"
    )


class Disturbance(Table):
    """tau_d, N m."""

    axes: tuple[Axis, ...] = Field(
        (), description="one for each of the m joints, or none; a bundled model takes 8 waves each"
    )


class Initial(Table):
    """Estimates and states of all robots at t_0."""

    position: InitialRows = Field(description="eps_i(t_0): {uniform = [low, high]} or n x m")
    velocity: InitialRows = Field(description="ups_i(t_0): {uniform = [low, high]} or n x m")
    q: InitialRows = Field(description="rad: {uniform = [low, high]} or n x m")
    qd: InitialRows = Field(description="rad/s: {uniform = [low, high]} or n x m")


class RobotInitial(Table):
    """Estimates and states of one robot at t_0; what is not given stays as for all."""

    position: InitialRow | None = None
    velocity: InitialRow | None = None
    q: InitialRow | None = None
    qd: InitialRow | None = None


class Robot(Table):
    """What one robot has of its own."""

    id: int = Field(strict=True, ge=1, description="1 to n")
    plant: Plant | None = None
    controller: Controller | None = None
    disturbance: Disturbance | None = None
    initial: RobotInitial = RobotInitial()


def _delay_form(value: Any) -> str:
    return DRAW if isinstance(value, dict | WholeUniform) else PERIODS


def _pair_form(value: Any) -> str:
    return PAIR if isinstance(value, dict | Pair) else NUMBER


Periods = Annotated[Count, Field(le=1000)]
Extent = Annotated[Number, Field(ge=0, le=1e100)]
Span = tuple[Weight, Weight]


class WholeUniform(Table):
    """A seeded draw of a whole number."""

    uniform: tuple[Periods, Periods] = Field(description="[low, high], both included")


class Pair(Table):
    """One number for positions and one for velocities."""

    position: Extent = 0.0
    velocity: Extent = 0.0


Delay = Annotated[
    Annotated[WholeUniform, Tag(DRAW)] | Annotated[Periods, Tag(PERIODS)],
    Discriminator(_delay_form),
]
Each = Annotated[
    Annotated[Extent, Tag(NUMBER)] | Annotated[Pair, Tag(PAIR)], Discriminator(_pair_form)
]


class FaultyLink(Table):
    """What is wrong with some links; a later entry's keys replace an earlier one's."""

    from_: Count | None = Field(
        None, alias="from", description="a node, 0 is the target; all unless given"
    )
    to: Count | None = Field(None, description="a robot; all unless given")
    loss: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="the probability that a sample is lost"
    )
    delay: Delay = Field(0, description="sampling periods: a whole number or {uniform = [a, b]}")
    outages: tuple[Span, ...] = Field(
        (), description="s; [from, to]: samples of from <= t_k < to are lost"
    )
    noise: Each = Field(
        0.0, description="standard deviation of what is added to each number of a sample"
    )
    quantisation: Each = Field(
        0.0, description="each number is rounded to a multiple of this, after the noise"
    )


class FaultyRobot(Table):
    """When a robot neither sends nor hears."""

    id: int = Field(strict=True, ge=1, description="1 to n")
    outages: tuple[Span, ...] = Field(
        (), description="s; [from, to]: at from <= t_k < to it neither sends nor hears"
    )


class Faults(Table):
    """What goes wrong between robots, by the seed and by the clock."""

    links: tuple[FaultyLink, ...] = ()
    robots: tuple[FaultyRobot, ...] = ()


class TlsTable(Table):
    """Certificates of the run's orchestrator, and of the hosts that may take part."""

    ca: str = Field(description="path of the authority's certificate, PEM, relative to this file")
    certificate: str = Field(description="path of the orchestrator's own")
    key: str = Field(description="path of its private key")
    hosts: dict[str, Text] = Field(
        {}, description="robots, such as 1-3,7, by the common name of their host's certificate"
    )


class BusTable(Table):
    """How hosts of a run on several machines talk."""

    deadline: Positive = Field(
        30.0, description="s of wall time; a tick that hosts do not close in it ends the run"
    )
    tls: TlsTable | None = None


class Scenario(Table):
    """A run, whole."""

    run: Run
    algorithm: AlgorithmChoice
    controller: Controller
    network: Network
    target: TargetMotion
    plant: Plant
    disturbance: Disturbance = Disturbance()
    initial: Initial
    robots: tuple[Robot, ...] = ()
    faults: Faults = Faults()
    bus: BusTable = BusTable()

    @property
    def n(self) -> int:
        """The number of robots."""
        return self.network.n

    @property
    def m(self) -> int:
        """The number of joints of each robot: the target's axes."""
        return self.target.m


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of scenario files."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Scenario.model_json_schema(),
    }
