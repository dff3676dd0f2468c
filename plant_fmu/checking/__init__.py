"""Whether an FMU can be a robot: valid, drivable, and moving as mechanics does."""
