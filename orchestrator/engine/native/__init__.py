"""What a tick does for all robots, by one call of native code each."""
