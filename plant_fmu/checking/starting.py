"""Whether a plant starts where it is told, and if not, which variables may say where it does.

What is found so is tried: a name is proposed where with it the plant starts there.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.proposals import as_line
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding
from nrs_cosim.plant_fmu.checking.mechanics import TORQUE, open_probe
from nrs_cosim.plant_fmu.drives.choice import Offer
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import StartError
from nrs_cosim.plant_fmu.plants import Body

ASIDE = 0.125
"""rad, rad/s, m or m/s: how far from its own start it is started."""


@dataclass(frozen=True, slots=True)
class Started:
    """That a plant does not start where it is told, with the names by which it does."""

    finding: Finding
    names: Mapping[str, Spec]


def starting(
    task: CheckTask, body: Body, offered: Sequence[Offer], chosen: Offer
) -> Started | None:
    """Start a plant beside its own start; None where it starts there, or cannot be opened."""
    names: dict[str, Spec] = {}
    refusal = _refused(task, body, offered, chosen)
    if refusal is None:
        return None
    first = refusal
    while refusal and refusal.instead and not names.keys() & refusal.instead.keys():
        names |= refusal.instead
        refusal = _refused(replace(task, names={**task.names, **names}), body, offered, chosen)
    if refusal:
        return Started(Finding("variables", "start", "note", str(first)), {})
    text = (
        f"it starts by parameters, and where it is told with the scenario's [plant]: "
        f"{as_line({**task.names, **names})}"
    )
    return Started(Finding("variables", "start", "note", text), names)


def _refused(
    task: CheckTask, body: Body, offered: Sequence[Offer], chosen: Offer
) -> StartError | None:
    aside = replace(body, q=body.q + ASIDE, qd=body.qd + ASIDE)
    try:
        with ExitStack() as stack:
            if any(offer.way in TORQUE for offer in offered):
                open_probe(stack, task.archive, aside, task.names, offered, chosen)
            else:
                open_plants(stack, task.archive, [aside], task.names, task.driving)
    except StartError as error:
        return error
    except CosimError:
        return None  # what is wrong is found by what comes next
    return None
