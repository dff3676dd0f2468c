"""A gallery of `scenarios`: what each shows, its picture and its command, as docs/gallery.md.

python -m docs.gallery docs    runs them all, and draws the pictures into docs/gallery
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import nrs_cosim as nrs

SCENARIOS = Path(__file__).parents[1] / "scenarios"
SUBJECTS = {
    "The paper's examples": ("paper_first_order", "paper_example_*"),
    "Clocks, links and networks": ("paper_jitter", "paper_lossy*", "switching", "hetero*"),
    "Many robots": ("ring_*", "random_*"),
    "Algorithms on one example": ("compare_*",),
    "Averages, and robots that lie": ("average_*", "byzantine_*"),
}
"""Which scenarios stand under which heading, in this order."""
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)
"""Of robots, at or below the lines of a picture."""


def scenarios() -> dict[str, list[Path]]:
    """Return the files under each heading; each scenario stands under one."""
    found = {
        heading: [path for name in names for path in sorted(SCENARIOS.glob(f"{name}.toml"))]
        for heading, names in SUBJECTS.items()
    }
    shown = sorted(path for paths in found.values() for path in paths)
    assert shown == sorted(SCENARIOS.glob("*.toml")), "SUBJECTS has each scenario once"
    return found


def page() -> str:
    """Return the text of docs/gallery.md."""
    parts = [
        "# Scenarios",
        "What lies in `scenarios/`, each run as it is. A picture has how far a robot's estimate "
        "(left) and the robot itself (right) are from the target, over time: the median of all "
        "robots in blue, the largest in orange, and all between the least and the largest shaded. "
        "What the keys mean is said in [paper_first_order](../scenarios/paper_first_order.toml) "
        "and in [the keys of a scenario](scenario.md). `make gallery` draws the pictures.",
    ]
    for heading, paths in scenarios().items():
        parts.append(f"## {heading}")
        for path in paths:
            parts += [
                f"### {path.stem}",
                _about(path.read_text("utf-8")),
                f"![Errors over time of {path.stem}](gallery/{path.stem}.png)",
                f"[`nrs run scenarios/{path.name} -o {path.stem}.mcap`](../scenarios/{path.name})",
            ]
    return "\n\n".join(parts) + "\n"


def _about(text: str) -> str:
    """Return the comment that a scenario begins with, as a paragraph with links."""
    comment = re.match(r"(?:#.*\n)+", text)
    assert comment, "a scenario begins with what it shows"
    about = " ".join(line.lstrip("# ").rstrip() for line in comment[0].splitlines())
    about = re.sub(
        r" See paper_first_order\.toml for what [a-z ]+ means?(, and (.*)|)\.",
        lambda m: f" See {m[2]}." if m[2] else "",
        about,
    )
    about = re.sub(r"\bdocs/([a-z/_]+)\.md", r"[\1](\1.md)", about)
    return re.sub(r"\b([a-z_]+)\.toml", r"[\1](#\1)", about)


def draw(path: Path, picture: Path) -> None:
    """Run a scenario, and draw how far estimates and robots are from the target."""
    with nrs.run(nrs.Scenario.load(path)) as recording:
        errors = recording.errors()
    t, at = np.unique(errors["t"], return_inverse=True)
    figure, axes = plt.subplots(1, 2, sharex=True, figsize=(6.4, 2.0), layout="constrained")
    for axis, name in zip(axes, ("position_estimate", "position_tracking"), strict=True):
        far = np.linalg.norm(errors[name], axis=1)
        of_robots = far[np.argsort(at, kind="stable")].reshape(len(t), -1)
        lines = np.quantile(of_robots, SHARES, axis=1)
        axis.fill_between(t, lines[0], lines[-1], alpha=0.2, linewidth=0)
        axis.plot(t, lines[2], linewidth=1.2)
        axis.plot(t, lines[-1], linewidth=0.8)
        axis.set_yscale("log")
        axis.tick_params(which="both", labelsize=7)
        axis.set_xlabel("simulated time (s)", fontsize=8)
    for axis, what in zip(axes, ("estimate", "robot"), strict=True):
        axis.set_ylabel(f"{what} to target (rad)", fontsize=8)
    figure.savefig(picture, dpi=100)
    plt.close(figure)


def drawn(folder: Path) -> Iterator[Path]:
    """Draw all pictures into a folder."""
    folder.mkdir(exist_ok=True)
    for path in sorted(SCENARIOS.glob("*.toml")):
        draw(path, folder / f"{path.stem}.png")
        yield path


def main() -> None:
    """Write the page, and draw its pictures."""
    mpl.use("agg")
    docs = Path(sys.argv[1])
    (docs / "gallery.md").write_text(page(), "utf-8")
    for path in drawn(docs / "gallery"):
        print(path.name)


if __name__ == "__main__":
    main()
