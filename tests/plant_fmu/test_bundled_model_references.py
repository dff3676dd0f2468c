"""References of the bundled models: they move on by their derivatives between settings."""

import numpy as np
import pytest

from tests.plant_fmu.fmpy_instances import Open
from tests.plant_fmu.test_bundled_models import each_version


@each_version
def test_a_reference_moves_with_its_velocity(robot: Open, fmi: int) -> None:
    with robot("planar_robot", fmi) as r:
        r.initialize(start=5.0, position_ref=[1.0, 2.0], velocity_ref=[0.5, 0.0])
        assert r.get("position_ref").tolist() == [1.0, 2.0]
        r.fmu.doStep(5.0, 0.5)
        assert r.get("position_ref").tolist() == [1.25, 2.0]
        r.set("velocity_ref", [2.0, -2.0])
        assert r.get("position_ref").tolist() == [1.25, 2.0]
        r.fmu.doStep(5.5, 0.5)
        assert r.get("position_ref").tolist() == [2.25, 1.0]
        r.set("tau", [1.0, 1.0])
        assert r.get("reference_time") == 5.5


@each_version
def test_a_reference_moves_with_its_acceleration(robot: Open, fmi: int) -> None:
    with robot("planar_robot", fmi) as r:
        r.initialize(position_ref=[1.0, 2.0], velocity_ref=[0.5, 0.0], acceleration_ref=[4.0, -8.0])
        r.fmu.doStep(0.0, 0.5)
        assert r.get("position_ref").tolist() == [1.75, 1.0]
        assert r.get("velocity_ref").tolist() == [2.5, -4.0]
        r.set("acceleration_ref", [0.0, 2.0])
        r.fmu.doStep(0.5, 0.5)
        assert r.get("position_ref").tolist() == [3.0, -0.75]
        assert r.get("velocity_ref").tolist() == [2.5, -3.0]
        r.set("position_ref", [0.0, 0.0])
        r.fmu.doStep(1.0, 0.5)
        assert r.get("position_ref").tolist() == [1.25, -1.25]


@pytest.mark.parametrize(
    "order", [("position_ref", "velocity_ref"), ("velocity_ref", "position_ref")]
)
@pytest.mark.parametrize("calls", [1, 2])
@each_version
def test_a_position_reference_holds_in_any_order_of_setting(
    robot: Open, fmi: int, calls: int, order: tuple[str, str]
) -> None:
    values = {"position_ref": [3.0, 4.0], "velocity_ref": [0.1, 0.2]}
    with robot("planar_robot", fmi) as r:
        r.initialize(position_ref=[1.0, 1.0], velocity_ref=[1.0, -1.0])
        r.fmu.doStep(0.0, 0.3)
        if calls == 2:
            for name in order:
                r.set(name, values[name])
        else:
            setter = r.fmu.setReal if fmi == 2 else r.fmu.setFloat64
            references = [reference for name in order for reference in r.references(name)]
            setter(references, [number for name in order for number in values[name]])
        assert r.get("position_ref").tolist() == values["position_ref"]
        r.fmu.doStep(0.3, 0.5)
        assert np.allclose(r.get("position_ref"), [3.05, 4.1], rtol=1e-15)
