"""An FMU on disk: checked, read, and its variables found."""
