"""A run: its robots, the worker that runs them, and the lockstep that closes its ticks."""
