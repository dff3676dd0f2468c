"""What a run that came to its end says of the theory beside it: a record, as `info` tells it.

A claim like any other of the file: its numbers are those of no other run only as far as somebody
computes them anew, as `nrs info --verify` does.
"""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat

_Number = Annotated[FiniteFloat, Field(ge=0)] | None


class _Part(BaseModel):
    """A part; keys that are not known are a later version's."""

    model_config = ConfigDict(frozen=True, extra="allow", defer_build=True)


class _Quantity(_Part):
    """One quantity of the run beside its bounds; see `analysis.comparison.ComparedQuantity`."""

    name: str
    measured: _Number
    tick: int
    bounds: dict[Literal["steady_state", "worst_case", "paper"], _Number]
    sampled: bool
    unproven: tuple[Literal["paper"], ...]
    transient: _Number
    rounding: _Number
    status: Literal["within", "transient", "exceeded", "unproven", "not measured"]
    above: tuple[Literal["steady_state", "worst_case", "paper"], ...]


_Of = Literal["position", "velocity"]
_Pairs = dict[_Of, tuple[FiniteFloat, ...]] | None
_Ranges = dict[_Of, tuple[tuple[FiniteFloat, FiniteFloat], ...]] | None


class _Noise(_Part):
    """What noise on links comes to, and came to; see `analysis.noise.NoiseAnalysis`."""

    source: str
    why_not: str
    deviation: _Pairs
    expected: _Ranges
    measured: _Pairs


class _MeanSquare(_Part):
    """Of errors over links that lose samples; see `analysis.mean_squares.RootMeanSquare`."""

    name: str
    expected: FiniteFloat
    measured: FiniteFloat
    robots_expected: tuple[FiniteFloat, ...]
    robots_measured: tuple[FiniteFloat, ...]


class TheoryRecord(_Part):
    """A run beside the theory; see `analysis.comparison.TheoryComparison`."""

    of: str
    """SHA-256 of all that it follows from: another run's, or another version's, is none."""
    why_not: str
    quantities: tuple[_Quantity, ...]
    spectral_radius: _Number
    measured_radius: _Number
    transient: _Number
    steady_since: _Number
    untracked: str
    noise: _Noise | None
    mean_squares: tuple[_MeanSquare, ...]

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON, as the comparison that it was made from does."""
        return self.model_dump(mode="json", exclude={"of"})
