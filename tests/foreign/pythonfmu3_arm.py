"""The arm as pythonfmu3 exports it: FMI 3.0, Co-Simulation, reference-driven, arrays.

Its servo drive has the paper's gains inside, and the paper's disturbance acts on its joints.
"""

from functools import partial
from math import cos, sin

from arm import advance
from pythonfmu3 import Dimension, Float64, Fmi3Causality, Fmi3Initial, Fmi3Slave, Fmi3Variability

KP, KD = 200.0, 300.0


class ServoArm(Fmi3Slave):
    """A slave with inputs position_ref, velocity_ref and outputs q, qd."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.held = 0.0, None
        self.register_variable(
            Float64(
                "time",
                causality=Fmi3Causality.independent,
                variability=Fmi3Variability.continuous,
            )
        )
        for name in ("position_ref", "velocity_ref"):
            self.register_vector(name, causality=Fmi3Causality.input)
        for name in ("q", "qd"):
            self.register_vector(name, causality=Fmi3Causality.output, initial=Fmi3Initial.exact)

    def register_vector(self, name, **attributes):
        """Register two numbers; the tool's own accessors need an older NumPy."""
        setattr(self, name, [0.0, 0.0])
        self.register_variable(
            Float64(
                name,
                dimensions=[Dimension(start="2")],
                getter=partial(getattr, self, name),
                setter=partial(setattr, self, name),
                **attributes,
            )
        )

    def do_step(self, current_time, step_size):
        """Extrapolate the reference from where it was last set, and follow it."""
        reference = (list(self.position_ref), list(self.velocity_ref))
        if self.held is None or self.held[1] != reference:
            self.held = (current_time, reference)
        since, (position, velocity) = self.held

        def torque(t, x):
            eps = [p + (t - since) * v for p, v in zip(position, velocity, strict=True)]
            pull = [KP * (e - q) for e, q in zip(eps, x[:2], strict=True)]
            damp = [KD * (v - d) for v, d in zip(velocity, x[2:], strict=True)]
            return pull[0] + damp[0] + 2 * sin(t), pull[1] + damp[1] + 2 * cos(2 * t)

        x = advance(current_time, step_size, [*self.q, *self.qd], torque)
        self.q, self.qd = x[:2], x[2:]
        return True
