"""Pinocchio's dynamics of a URDF, with vectors in any order of its joints, all of them free."""

import numpy as np


class Reference:
    """q, qd and force are (m,), of the joints named; the others rest where `locked` says."""

    def __init__(self, model, names, gravity, damping=0.0, locked=None) -> None:
        import pinocchio  # noqa: PLC0415, which is skipped without

        self.pinocchio, self.damping = pinocchio, damping
        if locked is not None:
            held = Reference(model, list(locked), gravity)
            at = held._theirs(np.array(list(locked.values()), float))
            model = pinocchio.buildReducedModel(model, held.ids, at)
        self.model = model
        self.model.gravity.linear = np.array(gravity, float)
        self.data = self.model.createData()
        self.ids = [self.model.getJointId(name) for name in names]
        assert max(self.ids, default=0) < self.model.njoints
        self.into = [self.model.joints[i].idx_v for i in self.ids]

    def acceleration(self, q, qd, force):
        """By articulated bodies."""
        v, tau = np.zeros(self.model.nv), np.zeros(self.model.nv)
        v[self.into], tau[self.into] = qd, force - self.damping * qd
        return self.pinocchio.aba(self.model, self.data, self._theirs(q), v, tau)[self.into]

    def mass(self, q):
        upper = np.triu(self.pinocchio.crba(self.model, self.data, self._theirs(q)))
        return (upper + np.triu(upper, 1).T)[np.ix_(self.into, self.into)]

    def bias(self, q, qd):
        """The forces at no acceleration, without damping."""
        v = np.zeros(self.model.nv)
        v[self.into] = qd
        model, data = self.model, self.data
        return self.pinocchio.nonLinearEffects(model, data, self._theirs(q), v)[self.into]

    def coupled(self, G, offset, q, qd, force, rotors=0.0):
        """Return the acceleration, (m,), of joints at G q + offset under a force, (m,), of q."""
        Q, Qd = G @ q + offset, G @ qd
        mass = self.mass(Q) + np.diag(np.broadcast_to(rotors, len(Q)))
        rest = force - G.T @ (self.bias(Q, Qd) + self.damping * Qd)
        return np.linalg.solve(G.T @ mass @ G, rest)

    def frames(self, q, links):
        """Return where links are, as SE3 in the world."""
        self.pinocchio.framesForwardKinematics(self.model, self.data, self._theirs(q))
        body = self.pinocchio.FrameType.BODY
        return [self.data.oMf[self.model.getFrameId(link, body)] for link in links]

    def _theirs(self, q):
        theirs = self.pinocchio.neutral(self.model)
        for i, angle in zip(self.ids, q, strict=True):
            there = self.model.joints[i].idx_q
            if self.model.joints[i].nq == 2:
                theirs[there : there + 2] = np.cos(angle), np.sin(angle)
            else:
                theirs[there] = angle
        return theirs
