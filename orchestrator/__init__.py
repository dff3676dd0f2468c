"""Time: the scenario, the lockstep of a run, and the command line."""
