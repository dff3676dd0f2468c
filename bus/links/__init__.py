"""What happens to samples on links that have faults."""
