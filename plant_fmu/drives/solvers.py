"""What moves a robot in Model Exchange through continuous time, up to the next event."""

from typing import Protocol


class Solver(Protocol):
    """A solver of one robot's dx/dt = f(t, x), see `drives.exchange_instance.Exchanged`."""

    def restart(self) -> None:
        """Forget the past: the robot's states, inputs or equations may have jumped."""

    def advance(self, until: float) -> bool:
        """Move the robot up to a time or just past its first event; return whether it has one.

        `StepError` names the time where the solver fails.
        """
