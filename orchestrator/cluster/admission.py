"""A worker that asks to join is given the run's secret, the scenario and its robots, encrypted.

An incarnation is public, and so is what a worker says to be let in: whoever repeats it gets the
same answer again, which its first speaker alone can read; who asks in other words is a stranger.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from nrs_cosim.bus.errors import BusError, InputError
from nrs_cosim.bus.network.access import expect_worker_name
from nrs_cosim.bus.text import storable
from nrs_cosim.bus.transport import Question
from nrs_cosim.orchestrator.cluster.assignment import Assignment, NotAdmittedError, WorkerSlot
from nrs_cosim.orchestrator.cluster.protocol import (
    AssetNote,
    Hello,
    NotExpectedError,
    Refusal,
    Welcome,
)
from nrs_cosim.orchestrator.cluster.worker_state import State
from nrs_cosim.orchestrator.scenario.assets import TABLE
from nrs_cosim.orchestrator.scenario.experiment import Experiment

_OPENING = {State.ADMITTED, State.OPENING}


@dataclass(frozen=True, slots=True)
class Fmu:
    """An FMU of the scenario."""

    sha256: str
    content: Callable[[], bytes]


@dataclass(frozen=True, slots=True)
class Admission:
    """Answers the workers that ask to join a run."""

    run: str
    """Its id."""
    file: Experiment
    fmus: Mapping[str, Fmu]
    """By what the scenario calls them."""
    secret: bytes
    slots: Assignment

    def answer(self, name: str, question: Question, now: float) -> WorkerSlot | None:
        """Let a worker in, or say why not; return the slot that it has now for the first time.

        `NotExpectedError` when somebody asks as a worker that is in, and is not to be answered.
        """
        # A run without workers has nothing to encrypt, and need not wait for what does it.
        from nrs_cosim.bus.encryption import expect_public_key  # noqa: PLC0415

        try:
            expect_worker_name(name, "--name")
            hello: Hello = Hello.read(question.payload)
            expect_public_key(hello.public)
            known = self.slots.get(name)
            is_known = known and known.life.incarnation == hello.incarnation
            slot = known if known and is_known else self.slots.place(name, hello, now)
        except (BusError, InputError, NotAdmittedError) as error:
            final = not isinstance(error, NotAdmittedError) or error.final
            if isinstance(error, NotAdmittedError):
                self.slots.refusal = f"{name} was not let in: {error}"
            question.answer(Refusal(reason=str(error), final=final).written())
            return None
        if is_known:
            if question.payload != slot.hello or slot.state not in _OPENING:
                raise NotExpectedError(f"another worker asks in the name of {name}")
            question.answer(slot.welcome)
            return None
        slot.life.join(hello.incarnation, now)
        slot.hello, slot.welcome = question.payload, self._welcome(slot, hello, question.key)
        question.answer(slot.welcome)
        return slot

    def _welcome(self, slot: WorkerSlot, hello: Hello, key: str) -> bytes:
        from nrs_cosim.bus.encryption import encrypt  # noqa: PLC0415

        file = self.file
        welcome = Welcome(
            run=self.run,
            secret=self.secret,
            name=file.name,
            scenario=file.text,
            assets={
                field: AssetNote.of(asset)
                for field, asset in file.assets.items()
                if asset.media_type == TABLE
            },
            folder=storable(str(file.folder.absolute())) if slot.process else None,
            fmus={fmu: about.sha256 for fmu, about in self.fmus.items()},
            robots=tuple(slot.robots),
        )
        return encrypt(hello.public, f"{self.run}/{key}", welcome.written())
