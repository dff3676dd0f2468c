"""What is said of a URDF file, collected while it is read, so that a user is told all at once.

What is the same of many elements is one line that names them all.
"""

from nrs_cosim.bus.plurals import plural


class Remarks:
    """Faults or warnings, in the order in which they were first found."""

    def __init__(self) -> None:
        self._names: dict[tuple[str, str], list[str]] = {}

    def __bool__(self) -> bool:
        return bool(self._names)

    def add(self, text: str, what: str = "", name: str = "") -> None:
        """Say something of the file, or of its link or joint (`what`) of some name."""
        names = self._names.setdefault((what, text), [])
        if name not in names:
            names.append(name)

    def take(self, others: "Remarks") -> None:
        """Say what others say."""
        for (what, text), names in others._names.items():
            for name in names:
                self.add(text, what, name)

    def lines(self) -> tuple[str, ...]:
        """Return a sentence for each."""
        return tuple(
            f"{plural(what, len(names))} {', '.join(map(repr, names))}: {text}" if what else text
            for (what, text), names in self._names.items()
        )
