"""Recordings for Foxglove and all that speak its protocol: a run as it goes on, or a replay."""
