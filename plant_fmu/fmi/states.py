"""The FMUs' own states: to go back by one step, or to go on in another process."""

from collections.abc import Sequence
from ctypes import byref, c_size_t, c_void_p, create_string_buffer

from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.batch_calls import place
from nrs_cosim.plant_fmu.fmi.calls import bind_states, is_fine, unless_fine
from nrs_cosim.plant_fmu.fmi.instances import Instances


class States:
    """A place for one state of each instance, freed with the library."""

    def __init__(self, instances: Instances) -> None:
        self._instances = instances
        self._calls = instances.library.bind(bind_states)
        self._states = (c_void_p * len(instances.handles))()
        self._keep = instances.rounds.recall(self._states, keeping=True)
        self._go_back = instances.rounds.recall(self._states, keeping=False)
        instances.library.ending.callback(self._free)

    def take(self, seconds: float) -> None:
        """Keep the instances' states."""
        self._instances.expect_all(self._keep(), "keeping its state", seconds)

    def put_back(self, seconds: float) -> None:
        """Return the instances to the states that were kept."""
        self._instances.expect_all(self._go_back(), "going back to a state", seconds)

    def save(self, seconds: float) -> list[bytes]:
        """Keep the instances' states, and return them as bytes."""
        self.take(seconds)
        return [self._bytes(row, seconds) for row in range(len(self._states))]

    def restore(self, data: Sequence[bytes], seconds: float) -> None:
        """Return the instances to states that were saved; `FmuError` where they refuse them."""
        for row, (handle, saved) in enumerate(zip(self._instances.handles, data, strict=True)):
            state = place(self._states, row)
            # Deserialising makes a new state there; of a null pointer, freeing does nothing.
            self._calls.free(handle, state)
            status = self._calls.deserialize(handle, saved, len(saved), state)
            if not is_fine(status):
                failure = self._instances.refusal(row, seconds, "reading a saved state", status)
                raise FmuError(str(failure))
        self.put_back(seconds)

    def _bytes(self, row: int, seconds: float) -> bytes:
        handle, state, size = self._instances.handles[row], self._states[row], c_size_t()
        status = self._calls.size(handle, state, byref(size))
        buffer = create_string_buffer(size.value)
        status = unless_fine(status) or self._calls.serialize(handle, state, buffer, size)
        if not is_fine(status):
            raise self._instances.refusal(row, seconds, "saving its state", status)
        return buffer.raw

    def _free(self) -> None:
        if self._instances.library.is_dead:
            return
        for row, handle in enumerate(self._instances.handles):
            self._calls.free(handle, place(self._states, row))
