"""The file format: messages of whole ticks as MCAP records, written, read and recovered."""
