"""Recordings for other tools: tables as CSV and Parquet, xarray, a scene in 3D."""
