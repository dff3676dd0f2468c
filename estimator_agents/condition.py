"""A condition of the theory is `left < right`, and its margin is `right − left`."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Condition:
    """One strict inequality, with the statement of the paper that it comes from."""

    name: str
    source: str
    left: float
    right: float
    sampled: bool = False
    """Whether the left side is the worst that was seen, in place of a bound; it may be greater."""
    at_least: bool = False
    """Whether the right side is the scenario's, which the left one is the bound of."""

    of_liars: bool = False
    """Whether it is on how many robots may lie, and where; others are of robots that do
    not lie."""

    @property
    def value(self) -> float:
        """What the scenario has."""
        return self.right if self.at_least else self.left

    @property
    def bound(self) -> float:
        """What it is to be below, or above where it is to be that at least."""
        return self.left if self.at_least else self.right

    @property
    def margin(self) -> float:
        """How far the left side stays below the right one; negative where it does not."""
        return self.right - self.left

    @property
    def holds(self) -> bool:
        """Whether the inequality is true."""
        return self.left < self.right
