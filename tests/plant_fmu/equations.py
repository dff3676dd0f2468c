"""An FMU for Model Exchange as a function: (q, qd, tau) to der(qd), as FMPy calls it."""

from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import fmi2, fmi3
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Equations:
    """der(qd) of an FMU for Model Exchange."""

    def __init__(self, path: Path, folder: Path) -> None:
        fmpy.extract(path, unzipdir=folder)
        description = fmpy.read_model_description(folder)
        self.fmi = 2 if description.fmiVersion == "2.0" else 3
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        arguments: dict[str, Any] = {
            "guid": description.guid or description.instantiationToken,
            "unzipDirectory": str(folder),
            "modelIdentifier": description.modelExchange.modelIdentifier,
            "instanceName": "robot",
        }
        self.fmu = (fmi2.FMU2Model if self.fmi == 2 else fmi3.FMU3Model)(**arguments)
        self.fmu.instantiate()
        if self.fmi == 2:
            self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.fmu.enterContinuousTimeMode()

    def acceleration(self, q: Array, qd: Array, tau: Array) -> Array:
        m = len(q)
        if self.fmi == 2:
            self.fmu.setReal([self.references[f"tau[{i + 1}]"] for i in range(m)], tau.tolist())
            derivatives = self.fmu.getDerivatives
        else:
            self.fmu.setFloat64([self.references["tau"]], tau.tolist())
            derivatives = self.fmu.getContinuousStateDerivatives
        x, dx = np.concatenate([q, qd]), np.zeros(2 * m)
        pointer = fmi2.POINTER(fmi2.fmi2Real)
        self.fmu.setContinuousStates(x.ctypes.data_as(pointer), 2 * m)
        derivatives(dx.ctypes.data_as(pointer), 2 * m)
        assert np.array_equal(dx[:m], qd)
        return dx[m:]
