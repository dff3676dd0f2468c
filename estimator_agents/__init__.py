"""The estimators of the target: algorithms, agents, and the theory of both."""
