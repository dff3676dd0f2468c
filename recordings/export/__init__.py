"""Recordings for other tools: tables as CSV, Parquet and MAT, xarray, a scene in 3D."""
