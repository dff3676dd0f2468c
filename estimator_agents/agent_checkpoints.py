"""What one robot's agent goes on from: its state, what its links remember, what it keeps of them.

Little-endian doubles behind a hash of what its algorithm declares, the same for every partition of
the robots.
"""

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.estimator_agents.algorithm import Algorithm, name_of
from nrs_cosim.estimator_agents.values import Array, Values, flattened, unflattened


@dataclass(frozen=True, slots=True)
class AgentCheckpoints:
    """Checkpoints of one algorithm's agents."""

    algorithm: Algorithm
    sizes: Sizes

    def pack(self, state: Values, memory: bytes, kept: Values, links: int) -> bytes:
        """Return a state (1, *shape), a buffer's memory, and link fields (links, *shape) as one."""
        doubles = (flattened(state, 1), flattened(kept, links))
        of_state, of_links = (flat.astype("<f8").tobytes() for flat in doubles)
        return joined([self._declared, of_state, memory, of_links])

    def unpack(self, robot: int, checkpoint: bytes, links: int) -> tuple[Array, bytes, Values]:
        """Return a state side by side, a memory, and link fields; `InputError` for another's."""
        parts = parted(checkpoint)
        if parts is None or len(parts) != 4 or parts[0] != self._declared:
            raise self.not_saved(robot)
        _, state, memory, kept = parts
        flat = np.frombuffer(kept, "<f8").reshape(links, -1)
        fields = unflattened(flat, self.algorithm.LINK, self.sizes)
        return np.frombuffer(state, "<f8"), memory, fields

    def not_saved(self, robot: int) -> InputError:
        """Return the error of a checkpoint that this algorithm did not save."""
        return InputError(
            f"robot {robot}'s checkpoint was not saved by algorithm {name_of(self.algorithm)} "
            "with the fields that it declares; start from t_0"
        )

    @property
    def _declared(self) -> bytes:
        """A hash of what the algorithm keeps, sends and receives."""
        of = self.algorithm
        fields = [
            [(name, field.size(self.sizes)) for name, field in declared.items()]
            for declared in (of.STATE, of.SENT, of.LINK)
        ]
        return sha256(repr((name_of(of), of.ARRIVALS, fields)).encode()).digest()[:8]
