"""What a robot believes of the target: algorithms, agents, and the theory of both."""
