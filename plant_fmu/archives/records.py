"""The records of a model description: FMPy's, which name the types, or those of `own_description`.

FMPy takes longer to load than all that is asked of a bundled model: nothing that only names its
types loads it.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fmpy.model_description import BaseUnit, ModelDescription, ModelVariable, Unit
else:
    BaseUnit = ModelDescription = ModelVariable = Unit = Any

__all__ = ["BaseUnit", "ModelDescription", "ModelVariable", "Unit"]
