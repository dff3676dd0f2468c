"""What is told of a run to people who look at it."""
