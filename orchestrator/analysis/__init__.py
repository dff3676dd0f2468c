"""What theory promises of a scenario, and whether a run kept to it."""
