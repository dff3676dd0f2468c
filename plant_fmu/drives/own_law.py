"""While an FMU is probed by torques they act alone and in full: a law that it holds is put out.

What it starts with would be taken for its mechanics: a limit cuts a push short, gains are a spring
and a damper, and what makes up for gravity hides it.
"""

from collections.abc import Mapping

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.presence import has, takes
from nrs_cosim.plant_fmu.archives.quantities import TYPES
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.drives.reference_driven import DISTURBANCE, GAINS, REFERENCE
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of, unsettable
from nrs_cosim.plant_fmu.plants import Array, Body

LIMIT, NO_LIMIT = "torque_limit", 1e30
PUT_OUT = (
    *GAINS,
    *("ki", "gravity_compensation", "acceleration_feedforward", "inertia_scaling"),
    "computed_torque",
    *DISTURBANCE,
)
"""What is 0 where a law is, and does nothing then."""


def without_own_law(archive: Archive, names: Mapping[str, Spec], body: Body) -> dict[str, Array]:
    """Return what puts the law out, by our names, of what the FMU has and lets be set, each (n,).

    What the body's parameters say stays. A limit is as high as the FMU lets it be.
    """
    assigned = assignments(archive, body.parameters)
    sizes = sizes_of(assigned)
    said = {reference for one in assigned if one.type in TYPES for reference in one.references}
    holds_law = takes(archive, names, *REFERENCE, sizes=sizes)
    values = {}
    for ours in (LIMIT, *(PUT_OUT if holds_law else ())):
        if not has(archive, names, ours, sizes=sizes):
            continue
        quantity = find_quantity(archive, ours, names, sizes=sizes)
        references = {part.reference for part in quantity.parts}
        variables = [
            variable
            for variable in archive.description.modelVariables
            if variable.type in TYPES and variable.valueReference in references
        ]
        if references & said or any(map(unsettable, variables)):
            continue
        most = [float(variable.max) for variable in variables if variable.max is not None]
        values[ours] = np.full(quantity.size, min([NO_LIMIT, *most]) if ours == LIMIT else 0.0)
    return values
