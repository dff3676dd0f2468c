"""A study: many runs of one scenario over axes and seeds, in a store that no crash loses."""
