"""The tables of a scenario file, and the values in them."""
