"""A scenario: its file, its tables, and what they come to as numbers."""
