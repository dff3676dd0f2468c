"""A run: its robots, the host that runs them, and the lockstep that closes its ticks."""
