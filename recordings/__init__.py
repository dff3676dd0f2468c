"""What was said: writing and reading it, and what follows from it."""
