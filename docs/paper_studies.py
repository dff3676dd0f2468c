"""Run the paper's theorems as studies: where estimates converge, and how large their errors are.

`python -m docs.paper_studies DATA PAGE` keeps rows in DATA, and writes figures and a page to PAGE.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import nrs_cosim as nrs
from nrs_cosim.recordings.report.print import INKS, STYLE

mpl.use("agg")
SCENARIOS = Path(__file__).parents[1] / "scenarios"
FIRST = nrs.Scenario.load(SCENARIOS / "paper_example_1a.toml")
SECOND = nrs.Scenario.load(SCENARIOS / "paper_example_3a.toml")
ALPHA, BETA, PERIOD = "algorithm.alpha", "algorithm.beta", "run.sampling_period"
COARSE = {"run.output_step": None, "run.duration": 20.0, "run.divergence_limit": 1e4}
TICKS = 200
"""Of runs over h: as many whatever h is."""
WIDTH = 0.01
GAINS = [0.3, 0.8, 1.1, 1.4]
PERIODS = [0.05, 0.15, 0.3, 0.42, 0.55]


@dataclass(frozen=True, slots=True)
class Case:
    """A map over two keys, whose boundary is narrowed along the second."""

    name: str
    title: str
    base: nrs.Scenario
    x: tuple[str, Sequence[float]]
    y: tuple[str, Sequence[float]]
    theorem: str
    ticks: int = TICKS

    def study(self, data: Path) -> nrs.Study:
        """Run it, or what of it is missing."""
        axes: dict[Any, Any] = {}
        for key, values in (self.x, self.y):
            if key == PERIOD:
                axes[PERIOD, "run.duration"] = [(h, round(h * self.ticks, 6)) for h in values]
            else:
                axes[key] = values
        return nrs.sweep(self.base, axes, out=data / self.name, refine=self.y[0], width=WIDTH)


CASES = (
    Case("first_gains", "first order, h = 0.1 s", FIRST.replace(COARSE),
         (ALPHA, GAINS), (BETA, GAINS), "Theorem 1"),
    Case("first_period", "first order, β = 0.9", FIRST.replace({**COARSE, BETA: 0.9}),
         (PERIOD, PERIODS), (ALPHA, GAINS), "Theorem 1"),
    Case("second_gains", "second order, h = 0.3 s",
         SECOND.replace({**COARSE, PERIOD: 0.3, "run.duration": 0.3 * TICKS}),
         (ALPHA, GAINS), (BETA, GAINS), "Theorem 3"),
    Case("second_period", "second order, β = 0.9", SECOND.replace({**COARSE, BETA: 0.9}),
         (PERIOD, PERIODS), (ALPHA, [0.3, 1.0, 2.0, 4.0]), "Theorem 3", 2 * TICKS),
)  # fmt: skip


def crossings(study: nrs.Study, case: Case) -> list[tuple[float, float, float]]:
    """Return, for each boundary that was found, x, the measured y, and that of theory's ρ = 1."""
    found = []
    for one in study.boundary(case.y[0]):
        measured = (one["low"] + one["high"]) / 2
        values = {key: value for key, value in one.items() if "." in key}
        low, high = case.y[1][0] / 2, case.y[1][-1] * 2
        for _ in range(40):
            middle = (low + high) / 2
            theory = nrs.check(case.base.replace({**values, case.y[0]: middle}))
            low, high = (middle, high) if theory.spectral_radius < 1 else (low, middle)
        found.append((one[case.x[0]], measured, low))
    return found


def conditions_end(case: Case, x: float) -> float:
    """Return up to which value of y the theorem's own conditions hold at an x."""
    low, high = 0.0, case.y[1][-1] * 2
    values = {case.x[0]: x}
    if case.x[0] == PERIOD:
        values["run.duration"] = round(x * case.ticks, 6)
    for _ in range(40):
        middle = (low + high) / 2
        theory = nrs.check(case.base.replace({**values, case.y[0]: middle}))
        kept = all(c.holds for c in theory.conditions if case.theorem in c.source)
        low, high = (middle, high) if kept else (low, middle)
    return low


def draw_map(axes: Axes, study: nrs.Study, case: Case) -> list[tuple[float, float, float]]:
    """Draw runs as dots, with the boundaries; return these."""
    frame = study.to_pandas()
    for status, marker, colour in (
        ("converged", "o", INKS[0]), ("not_converged", "x", INKS[1]), ("diverged", "x", INKS[3]),
    ):  # fmt: skip
        part = frame[frame["status"] == status]
        axes.plot(part[case.x[0]], part[case.y[0]], marker, ms=3, color=colour,
                  label=status.replace("_", " "))  # fmt: skip
    found = crossings(study, case)
    axes.plot([x for x, _, _ in found], [t for *_, t in found], "-", color=INKS[2], label="ρ = 1")
    ends = [(x, conditions_end(case, x)) for x in case.x[1]]
    axes.step(*zip(*[e for e in ends if e[1] > 0], strict=True), "--", where="mid", color="#1b1f24",
              label=case.theorem)  # fmt: skip
    axes.set(xlabel=_name(case.x[0]), ylabel=_name(case.y[0]), title=case.title,
             ylim=(0, case.y[1][-1] * 1.05))  # fmt: skip
    return found


def draw_errors(axes: Axes, data: Path) -> None:
    """Draw the error of positions over h: measured, and its bounds."""
    for number, (name, base) in enumerate((("first order", FIRST), ("second order", SECOND))):
        periods = [0.02, 0.05, 0.1, 0.2, 0.4]
        study = nrs.sweep(
            base.replace(COARSE),
            {(PERIOD, "run.duration"): [(h, round(max(200 * h, 20.0), 6)) for h in periods]},
            out=data / f"errors_{number}",
        )
        frame = study.to_pandas()
        axes.plot(frame[PERIOD], frame["position_estimate"], "o", ms=4, color=INKS[number],
                  label=f"{name}, measured")  # fmt: skip
        for bound, style in (("steady_state", "-"), ("worst_case", "--"), ("paper", ":")):
            drawn = [
                getattr(nrs.check(base.replace({PERIOD: h, "run.duration": 200 * h,
                                                "run.output_step": None})).bounds[0], bound)
                for h in periods
            ]  # fmt: skip
            axes.plot(periods, drawn, style, color=INKS[number], lw=1,
                      label=bound.replace("_", " ") if number == 0 else None)  # fmt: skip
    axes.set(xscale="log", yscale="log", xlabel="h, s", ylabel="sup ‖ε̄‖∞, rad",
             title="error over h")  # fmt: skip
    axes.set_xticks(periods, [f"{h:g}" for h in periods])
    axes.minorticks_off()
    axes.legend(fontsize=6)


def draw_losses(axes: Axes, data: Path) -> str:
    """Draw the share of runs that converged over the loss; return the row of the page."""
    base = SECOND.replace({**COARSE, "algorithm.missing": "drop", "faults.links": [{"loss": 0.0}]})
    losses = [0.0, 0.3, 0.5, 0.65, 0.75, 0.85, 0.95]
    critical = None
    for number, period in enumerate((0.1, 0.3)):
        scenario = base.replace({PERIOD: period, "run.duration": period * TICKS})
        study = nrs.sweep(
            scenario, {"faults.links.0.loss": losses}, seeds=8, out=data / f"losses_{number}"
        )
        table = study.statistics()
        loss, share = table["faults.links.0.loss"], table["converged"]
        band = table["converged_low"], table["converged_high"]
        axes.plot(loss, share, ".-", color=INKS[number], label=f"h = {period:g} s, of 8 seeds")
        axes.fill_between(loss, *band, color=INKS[number], alpha=0.15, lw=0)
        frame = study.to_pandas()
        critical = float(frame["critical_loss"].dropna().iloc[0])
        axes.axvline(critical, color=INKS[number], ls="--", lw=1, label=f"p* = {critical:.3f}")
    axes.set(xlabel="loss of every link", ylabel="share converged, 95 %", ylim=(-0.03, 1.03),
             title="second order, without what is lost")  # fmt: skip
    axes.legend(fontsize=6)
    return f"p* at h = 0.3 s is {critical:.4f}" if critical else ""


def _name(key: str) -> str:
    return {ALPHA: "α", BETA: "β", PERIOD: "h, s"}[key]


def main(data: Path, page: Path) -> None:
    """Run all studies, and write the figures and the page."""
    lines = [
        "# The paper's theorems as studies",
        "",
        "Written by `make paper`: `nrs.sweep` over gains and periods, boundaries narrowed to "
        f"{WIDTH:g}.",
        "",
        "| map | boundary found at | ρ = 1 of theory | off by at most |",
        "|---|---|---|---|",
    ]
    with mpl.rc_context(STYLE):
        figure, axes = plt.subplots(2, 2, figsize=(8.0, 6.4), layout="constrained")
        for one, case in zip(axes.flat, CASES, strict=True):
            found = draw_map(one, case.study(data), case)
            off = max(abs(measured / theory - 1) for _, measured, theory in found)
            lines.append(_row(case, found, off))
        axes[1, 1].legend(fontsize=6, loc="upper right")
        figure.savefig(page / "study_maps.png")
        figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.4), layout="constrained")
        draw_errors(axes[0], data)
        critical = draw_losses(axes[1], data)
        figure.savefig(page / "study_errors.png")
    lines += [
        "",
        "![Where runs converge, over gains and periods](study_maps.png)",
        "",
        f"Runs of {TICKS} ticks, below right of {2 * TICKS}; one seed. A circle converged, a cross "
        "did not or diverged. The line is ρ = 1, the dashes are where the theorem's conditions "
        "end.",
        "",
        "![Errors over h, and shares over loss](study_errors.png)",
        "",
        "Left: errors of positions in the last fifth beside the bounds of this target, of any, "
        "and the paper's. Right: over links that lose samples, the share of runs that converge "
        f"beside the loss p* up to which they do in mean square; {critical}. Single runs may "
        "converge beyond it (statement L4).",
        "",
    ]  # fmt: skip
    (page / "studies.md").write_text("\n".join(lines), "utf-8")


def _row(case: Case, found: Sequence[tuple[float, float, float]], off: float) -> str:
    name = f"{case.title}: {_name(case.y[0])} over {_name(case.x[0])}"
    values = [", ".join(f"{one[at]:.4g}" for one in found) for at in (1, 2)]
    return f"| {name} | {values[0]} | {values[1]} | {100 * off:.2g} % |"


if __name__ == "__main__":
    main(Path(sys.argv[1]) / "studies", Path(sys.argv[2]))
