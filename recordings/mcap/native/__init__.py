"""What becomes of a chunk's messages, by one call of native code."""
