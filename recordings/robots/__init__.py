"""Robots as they are drawn: what a URDF says of links and joints, and where they are at a time."""
