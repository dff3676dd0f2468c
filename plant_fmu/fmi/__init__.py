"""An FMU in memory: its calls, its instances, its state."""
