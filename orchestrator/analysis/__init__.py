"""Theory of an experiment: conditions, convergence, bounds; and a run beside them."""
