"""A recording run again, published again, or compared."""
