"""What may travel between robots, between whom, and how: messages, keys, topology, transport."""
