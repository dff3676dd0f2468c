"""A bus carries bytes from a key to all who listen on it, in order, and drops nothing.

All that one party receives comes into one inbox, in the order of arrival: messages, who is present,
and on a network also lost links, questions and answers. Keys are the run's own, whatever stands
before them on the wire; patterns follow Zenoh: `*` stands for one part of a key.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

Put = Callable[[bytes], None]
"""Puts one message on the key that it was made for."""


class Message(NamedTuple):
    """What was put on a key."""

    key: str
    payload: bytes


class Presence(NamedTuple):
    """Somebody came, or is gone."""

    key: str
    here: bool


class Cut(NamedTuple):
    """The link to a session is lost."""

    peer: str | None
    """The session's id; None where there is one link only, to whatever is beyond it."""


class Answer(NamedTuple):
    """What was answered to the question that was asked on a key; None after the last answer."""

    key: str
    payload: bytes | None


class Rejected(NamedTuple):
    """Something came that was not kept, for a reason."""

    why: str


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """What somebody asks on a key, to be answered once."""

    key: str
    payload: bytes
    answer: Put


Item = Message | Presence | Cut | Answer | Question | Rejected
Screen = Callable[[str, bytes], str | None]
"""Says of a key and what came on it why it is not to be kept; None for what is."""


class Inbox(Protocol):
    """What arrived for one party and was not yet taken."""

    def take(self, seconds: float = 0.0) -> list[Item]:
        """Return all that arrived, in order, and forget it.

        When nothing has, wait for it, at most for so many seconds of wall time.
        """


class Side:
    """One of two parties that have an inbox together, each of which gets all that comes."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self.waiting: list[Item] = []
        self.other = self

    def take(self, seconds: float = 0.0) -> list[Item]:
        """Return all that arrived, in order; see `Inbox`."""
        arrived = self._inbox.take(0.0 if self.waiting else seconds)
        self.other.waiting += arrived
        return self.pending() + arrived

    def pending(self) -> list[Item]:
        """Return what the other side took out of the inbox, and forget it."""
        mine, self.waiting = self.waiting, []
        return mine

    def add(self, item: Item) -> None:
        """Let both get what came into the inbox and was taken out of it by somebody else."""
        self.waiting.append(item)
        self.other.waiting.append(item)


def tee(inbox: Inbox) -> tuple[Side, Side]:
    """Return two inboxes, for use in one thread, that both get what comes into one."""
    one, other = Side(inbox), Side(inbox)
    one.other, other.other = other, one
    return one, other


class Bus(Protocol):
    """A party's way to the bus."""

    def publisher(self, key: str) -> Put:
        """Declare the right to put on a key."""

    def listen(self, *patterns: str) -> Inbox:
        """Hear every key that a pattern matches, from now on, in an inbox of its own."""

    def close(self) -> None:
        """End the session; its publishers and inboxes are void from now on."""
