"""What was said: writing and reading it, and what follows from it.

`Recording` is the way in for users of Python.
"""

from recordings.recording import Recording

__all__ = ["Recording"]
