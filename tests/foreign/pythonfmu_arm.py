"""The arm as pythonfmu exports it: FMI 2.0, Co-Simulation, torque-driven, scalars q1, q2, …"""

from arm import advance
from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Real


class PythonArm(Fmi2Slave):
    """A slave with inputs tau1, tau2 and outputs q1, q2, qd1, qd2."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name in ("tau1", "tau2"):
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("q1", "q2", "qd1", "qd2"):
            setattr(self, name, 0.0)
            self.register_variable(
                Real(name, causality=Fmi2Causality.output, initial=Fmi2Initial.exact, start=0.0)
            )

    def do_step(self, current_time, step_size):
        """Hold the torque over the step."""
        x = [self.q1, self.q2, self.qd1, self.qd2]
        held = (self.tau1, self.tau2)
        self.q1, self.q2, self.qd1, self.qd2 = advance(
            current_time, step_size, x, lambda _t, _x: held
        )
        return True
