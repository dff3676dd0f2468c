"""What of a recording is wanted: some robots, some of their joints, some time; the target stays."""

from dataclasses import dataclass

TARGET = 0


@dataclass(frozen=True, slots=True)
class Selected:
    """All unless given."""

    robots: tuple[int, ...] | None = None
    """Their numbers, ascending."""
    joints: tuple[int, ...] | None = None
    """Their numbers, ascending, from 1."""
    start_ns: int | None = None
    end_ns: int | None = None
    """The end is excluded."""

    @property
    def nodes(self) -> frozenset[int] | None:
        """The robots and the target; None where they are all."""
        return None if self.robots is None else frozenset({TARGET, *self.robots})


ALL = Selected()
NOTHING = "has no messages of these robots and times"
