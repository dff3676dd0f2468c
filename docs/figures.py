"""Draw the figures of the documents from recordings: `python -m docs.figures RECORDING FIGURE.png`.

Like the paper's: estimates against the target above, tracking errors below, a line a robot.
"""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from orchestrator.setting import target_of
from orchestrator.summary import scenario_of
from recordings.reading import Reader
from recordings.tables import samples, states

mpl.use("agg")
STYLE = {
    "font.size": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.0,
    "figure.dpi": 160,
}


def draw(recording: Path, figure: Path, until: float = 8.0) -> None:
    """Draw one joint's estimates and all tracking errors of a recording, up to a time in s."""
    with Reader(recording) as reader, mpl.rc_context(STYLE):
        sampled, moved = (
            table[table["time_ns"] <= until * 1e9]
            for table in (np.concatenate(list(tables(reader))) for tables in (samples, states))
        )
        target = target_of(scenario_of(reader).scenario)
        motion = target.at(moved["time_ns"] / 1e9)
        errors = {
            r"$\|q_i - \varepsilon_0\|_2$  (rad)": moved["q"] - motion.position,
            r"$\|\dot q_i - \upsilon_0\|_2$  (rad/s)": moved["qd"] - motion.velocity,
        }
        page, axes = plt.subplots(2, 2, figsize=(8, 4.6), sharex=True, constrained_layout=True)
        for robot in range(1, int(moved["robot"].max()) + 1):
            mine = moved["robot"] == robot
            t = moved["time_ns"][mine] / 1e9
            axes[0, 0].plot(t, moved["position"][mine, 0], label=f"robot {robot}")
            axes[0, 1].plot(t, moved["velocity"][mine, 0])
            for ax, error in zip(axes[1], errors.values(), strict=True):
                ax.semilogy(t, np.linalg.norm(error[mine], axis=1))
        heard = sampled[sampled["robot"] == 0]
        for ax, name in zip(axes[0], ("position", "velocity"), strict=True):
            ax.plot(
                heard["time_ns"] / 1e9, heard[name][:, 0], "k.", ms=2.5, label="target at $t_k$"
            )
        labels = (r"$\varepsilon_{i}$, joint 1  (rad)", r"$\upsilon_{i}$, joint 1  (rad/s)")
        for ax, label in zip(axes.flat, (*labels, *errors), strict=True):
            ax.set_ylabel(label)
            ax.set_xlim(0, until)
        for ax in axes[1]:
            ax.set_xlabel("simulated time (s)")
        axes[0, 0].legend(ncols=2, fontsize=6, frameon=False)
        page.savefig(figure, metadata={"Software": ""})


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
