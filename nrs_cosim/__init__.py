"""Co-simulation of networked robots under sampled interaction."""
