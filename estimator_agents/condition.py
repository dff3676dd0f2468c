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

    @property
    def margin(self) -> float:
        """How far the left side stays below the right one; negative where it does not."""
        return self.right - self.left

    @property
    def holds(self) -> bool:
        """Whether the inequality is true."""
        return self.left < self.right
