"""An instance of a bundled model as FMPy drives it: one surface for FMI 2 and 3."""

from collections.abc import Callable
from ctypes import POINTER, c_double
from math import prod
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy import fmi2, fmi3
from fmpy.fmi1 import FMICallException
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.bundled.declaration import declaration

Array = NDArray[np.float64]
Open = Callable[..., Any]


class Robot:
    """An instance of a bundled model, its variables by name and as arrays."""

    def __init__(self, model: str, fmi: int, folder: Path, kind: str, token: str = "") -> None:
        self.declaration = declaration(model, fmi)
        self.lengths = {d.name: d.start for d in self.declaration.dimensions}
        self.fmi = fmi
        self.said: list[str] = []
        description = fmpy.read_model_description(folder)
        arguments: dict[str, Any] = {
            "guid": token or description.guid or description.instantiationToken,
            "unzipDirectory": str(folder),
            "modelIdentifier": model,
            "instanceName": "robot",
        }
        if fmi == 2:
            self.fmu = getattr(fmi2, f"FMU2{kind}")(**arguments)
            callbacks = fmi2.fmi2CallbackFunctions()
            callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(lambda *a: self._receive(a[4]))
            callbacks.allocateMemory = fmi2.defaultCallbacks.allocateMemory
            callbacks.freeMemory = fmi2.defaultCallbacks.freeMemory
            log: dict[str, Any] = {"callbacks": callbacks}
        else:
            self.fmu = getattr(fmi3, f"FMU3{kind}")(**arguments)
            log = {"logMessage": lambda *a: self._receive(a[3])}
        try:
            self.fmu.instantiate(**log)
        except Exception:
            self.fmu.freeLibrary()
            raise

    def _receive(self, message: bytes) -> None:
        self.said.append(message.decode())

    def configure(self, name: str, count: int) -> None:
        """Sets a structural parameter, in Configuration Mode."""
        self.fmu.enterConfigurationMode()
        self.fmu.setUInt64(self.references(name), [count])
        self.fmu.exitConfigurationMode()
        self.lengths |= {d.name: count for d in self.declaration.dimensions if d.by == name}

    def shape(self, name: str) -> tuple[int, ...]:
        return tuple(self.lengths[d.name] for d in self.declaration.variable(name).dimensions)

    def references(self, name: str) -> list[int]:
        v = self.declaration.variable(name)
        return [v.value_reference + i for i in range(v.size if self.fmi == 2 else 1)]

    def set(self, name: str, value: Any) -> None:
        setter = self.fmu.setReal if self.fmi == 2 else self.fmu.setFloat64
        setter(self.references(name), np.ravel(value).tolist())

    def get(self, name: str) -> Array:
        shape = self.shape(name)
        if self.fmi == 2:
            values = self.fmu.getReal(self.references(name))
        else:
            values = self.fmu.getFloat64(self.references(name), nValues=prod(shape))
        return np.array(values).reshape(shape)

    def derivatives(self, t: float, x: Array) -> Array:
        """Of the states `x` at `t`, in model exchange and continuous-time mode."""
        rates = np.zeros(len(x))
        call = self.fmu.getDerivatives if self.fmi == 2 else self.fmu.getContinuousStateDerivatives
        self.fmu.setTime(t)
        self.fmu.setContinuousStates(_address(x), len(x))
        call(_address(rates), len(x))
        return rates

    def initialize(self, start: float = 0.0, **settings: Any) -> None:
        for name, value in settings.items():
            self.set(name, value)
        if self.fmi == 2:
            self.fmu.setupExperiment(startTime=start)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start)
        self.fmu.exitInitializationMode()

    def refuses(self, call: Callable[[], Any]) -> str:
        """The message with which an FMI call fails."""
        with pytest.raises(FMICallException, match=r"\(error\)"):
            call()
        return self.said[-1]


def _address(numbers: Array) -> Any:
    return numbers.ctypes.data_as(POINTER(c_double))
