"""A run taken elsewhere: its robots and target as FMUs, and how they are connected."""
