"""What scripts and notebooks use: scenarios, theory, runs and recordings; `nrs_cosim` names it."""
