"""The network in a scenario: digraphs of several forms, and its phases."""

from functools import cached_property
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from nrs_cosim.orchestrator.scenario.tables.values import (
    EDGE,
    WEIGHTED,
    Node,
    Number,
    Positive,
    RobotNumber,
    Table,
    Text,
    Tick,
    Weight,
    WhenGiven,
)


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
        description="ring: i receives from i-1, and 1 from n; path: the same, but that 1 receives "
        "from no robot; star: all receive from robot 1; random_k_in: each from k others; "
        "small_world: k neighbours on each side, both ways, some of them rewired"
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
        (1,), min_length=1, description="the robots that receive from the target"
    )
    weight: Positive = Field(1.0, description="of every edge")


class Digraph(Table):
    """Who receives from whom, in one of these forms: adjacency with pinning, or one of others."""

    adjacency: tuple[tuple[Weight, ...], ...] | None = Field(
        None, min_length=1, description="n x n; [i][j] > 0: robot i+1 receives from robot j+1"
    )
    pinning: tuple[Weight, ...] | None = Field(
        None, description="n; [i] > 0: robot i+1 receives from the target"
    )
    generator: Generator | None = Field(None, description="a network by rule")
    edge_list: tuple[EdgeEntry, ...] | None = Field(
        None,
        min_length=1,
        description="[source, sink] or [source, sink, weight], where sink "
        "receives from source; 0 is the target, n the largest number; the weight is 1 unless given",
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


class InteractionTable(Digraph):
    """Who receives from whom: one digraph, or one for positions and one for velocities."""

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


class PhaseTable(InteractionTable):
    """Who receives from whom from a tick on."""

    from_: Tick = Field(alias="from", description="the first tick of it, k; 1 in the first entry")


class Network(InteractionTable):
    """Who receives from whom, always the same or by phase."""

    switching: tuple[Annotated[PhaseTable, WhenGiven(PhaseTable)], ...] | None = Field(
        None,
        min_length=1,
        description="phases of a switching topology, each from a tick to the next one's",
    )
    repeat: Tick | None = Field(
        None, description="ticks after which the phases come again; by default the last one stays"
    )

    @property
    def forms(self) -> list[str]:
        """The forms that are given, where there must be one."""
        return [*super().forms, *(["switching"] if self.switching else [])]

    @cached_property
    def n(self) -> int:
        """The number of robots."""
        return self.switching[0].n if self.switching else super().n
