"""What can be promised of a run before it, and told of it after: docs/theory.md derives it."""
