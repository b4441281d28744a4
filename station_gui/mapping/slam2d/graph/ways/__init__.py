"""Which nodes are near: along the edges, and as the crow flies."""
