"""All instances of an FMU called by one call of native code."""
