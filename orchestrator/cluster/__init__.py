"""Robots spread over processes and machines, and the one that starts and watches them."""
