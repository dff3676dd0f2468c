"""A scenario is data: a TOML file, parsed once into frozen values of known types and shapes.

Each class in these modules is a table of the file, and its fields are the keys that the table may
have. n is the number of robots and m the number of the target's axes.
"""

from typing import Annotated, Any

from pydantic import ConfigDict, Field

from nrs_cosim.orchestrator.scenario.tables.algorithms import AlgorithmChoice
from nrs_cosim.orchestrator.scenario.tables.faults import Faults
from nrs_cosim.orchestrator.scenario.tables.fmus import OwnPlant, Plant
from nrs_cosim.orchestrator.scenario.tables.networks import Network
from nrs_cosim.orchestrator.scenario.tables.targets import Axis, TargetMotion
from nrs_cosim.orchestrator.scenario.tables.values import (
    Count,
    Gain,
    InitialArray,
    InitialRow,
    InitialRows,
    JointNumbers,
    Number,
    Positive,
    Table,
    Text,
    TorqueLimit,
    WhenGiven,
)


class Run(Table):
    """How long, how often, and from which seed."""

    duration: Positive | None = Field(
        None,
        description="s; a whole number of sampling periods, or of rounds of sampling_times, which "
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
        min_length=1,
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


_MADE_UP_FOR = "; of bundled models, those of a URDF, and Model Exchange"


class Controller(Table):
    """tau = u = kp (position_i − q) + kd (velocity_i − qd), and more where it is asked for.

    Either kp and kd, or a frequency, are given.
    """

    kp: Gain | None = Field(None, description="N m/rad: a number, m numbers, or m x m")
    kd: Gain | None = Field(None, description="N m s/rad: a number, m numbers, or m x m")
    frequency: JointNumbers | None = Field(
        None,
        description="rad/s, a number or m numbers: u = M(q) (w² e + 2 damping w de/dt), so that "
        f"each joint has this bandwidth in every posture, in place of kp and kd{_MADE_UP_FOR}",
    )
    damping: JointNumbers | None = Field(
        None, description="with frequency, 1 by default: a number or m numbers"
    )
    ki: Gain | None = Field(
        None,
        description="N m/(rad s), as kp, or 1/s³ with frequency: ki times the integral of "
        f"position_i − q, which rests where torque_limit keeps it from counting{_MADE_UP_FOR}",
    )
    torque_limit: TorqueLimit | None = Field(
        None,
        description='N m: the most of tau, either way: a number, m numbers, or "effort", which '
        "is each joint's in the URDF that the FMU is of",
    )
    gravity_compensation: bool = Field(
        False, strict=True, description=f"tau has G(q) too{_MADE_UP_FOR}"
    )
    acceleration_feedforward: bool = Field(
        False,
        strict=True,
        description=f"tau has M(q) times the acceleration of the estimate too{_MADE_UP_FOR}",
    )
    computed_torque: bool = Field(
        False,
        strict=True,
        description="with frequency: tau makes up for all that acts on a robot but tau_d, so that "
        f"its acceleration is the estimate's and that of the error's oscillator{_MADE_UP_FOR}",
    )


class OwnController(Table):
    """What one robot has otherwise; what is not given stays as for all."""

    kp: Gain | None = Field(None, description="N m/rad: as in [controller]")
    kd: Gain | None = Field(None, description="N m s/rad: as in [controller]")
    frequency: JointNumbers | None = Field(None, description="rad/s: as in [controller]")
    damping: JointNumbers | None = Field(None, description="as in [controller]")
    ki: Gain | None = Field(None, description="as in [controller]")
    torque_limit: TorqueLimit | None = Field(None, description="N m: as in [controller]")
    gravity_compensation: bool = Field(False, strict=True, description="as in [controller]")
    acceleration_feedforward: bool = Field(False, strict=True, description="as in [controller]")
    computed_torque: bool = Field(False, strict=True, description="as in [controller]")


class Disturbance(Table):
    """tau_d, N m."""

    axes: tuple[Axis, ...] = Field(
        (), description="one for each of the m joints, or none; a bundled model takes 8 waves each"
    )


_ROW = "a number, m numbers, or {uniform = [low, high]}"
_ROWS = "a number, m numbers, n x m numbers, or {uniform = [low, high]}"


class Kept(Table):
    """What robots start with: these keys, and each further field that the algorithm keeps."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, InitialArray] = Field(init=False)

    def given(self, name: str) -> Any:
        """Return what is given for a field; None where nothing is."""
        if name in type(self).model_fields:
            return getattr(self, name)
        return (self.model_extra or {}).get(name)


class Initial(Kept):
    """Estimates and states of all robots at t_0: at rest at 0, unless given.

    A number is that of all joints of all robots, m numbers are those of each robot. Each further
    field that the algorithm keeps is a key too: a number, numbers in its shape, numbers in that
    shape for each of the n robots, or a draw.
    """

    position: InitialRows = Field(0.0, description=f"eps_i(t_0): {_ROWS}")
    velocity: InitialRows = Field(0.0, description=f"ups_i(t_0): {_ROWS}")
    q: InitialRows = Field(0.0, description=f"rad: {_ROWS}")
    qd: InitialRows = Field(0.0, description=f"rad/s: {_ROWS}")


class RobotInitial(Kept):
    """Estimates and states of one robot at t_0; what is not given stays as for all.

    Further fields are keys as in [initial].
    """

    position: InitialRow | None = Field(None, description=f"eps_i(t_0): {_ROW}")
    velocity: InitialRow | None = Field(None, description=f"ups_i(t_0): {_ROW}")
    q: InitialRow | None = Field(None, description=f"rad: {_ROW}")
    qd: InitialRow | None = Field(None, description=f"rad/s: {_ROW}")


class Robot(Table):
    """What one robot has of its own; what is not given stays as for all."""

    id: int = Field(strict=True, ge=1, description="1 to n")
    plant: OwnPlant | None = Field(None, description="another FMU, or other keys of [plant]")
    controller: OwnController | None = Field(None, description="other gains")
    disturbance: Disturbance | None = Field(None, description="in place of [disturbance]")
    initial: RobotInitial = Field(RobotInitial.model_construct(), description="another start")


class TlsTable(Table):
    """Certificates of the run's orchestrator, and of the workers that may take part."""

    ca: str = Field(description="path of the authority's certificate, PEM, relative to this file")
    certificate: str = Field(description="path of the orchestrator's own")
    key: str = Field(description="path of its private key")
    workers: dict[str, Text] = Field(
        {}, description="robots, such as 1-3,7, by the common name of their worker's certificate"
    )


class BusTable(Table):
    """How workers of a run on several machines talk."""

    deadline: Positive = Field(
        30.0,
        description="s of wall time; the run ends when workers do not complete a tick within it",
    )
    tls: TlsTable | None = Field(None, description="certificates, for runs over several machines")


# Defaults that are tables are constructed without validation, which would compile each at start-up.
class Scenario(Table):
    """A run, whole."""

    run: Run = Field(description="how long, how often, and from which seed")
    algorithm: AlgorithmChoice = Field(description="the estimator and its parameters")
    controller: Controller = Field(description="the PD loop by which a robot follows its estimate")
    network: Network = Field(description="who receives from whom, and who receives from the target")
    target: TargetMotion = Field(description="how the target moves, and so the number of joints m")
    plant: Plant = Field(description="the FMU of the robots' dynamics")
    disturbance: Disturbance = Field(
        Disturbance.model_construct(), description="a torque from outside"
    )
    initial: Initial = Field(Initial.model_construct(), description="estimates and states at t_0")
    robots: tuple[Annotated[Robot, WhenGiven(Robot)], ...] = Field(
        (), description="what single robots have of their own"
    )
    faults: Annotated[Faults, WhenGiven(Faults)] = Field(
        Faults.model_construct(), description="what links and robots do to samples"
    )
    bus: BusTable = Field(
        BusTable.model_construct(), description="how the processes of a run communicate"
    )

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
