"""The robots' dynamics as FMUs: bundled models, building, reading, stepping."""
