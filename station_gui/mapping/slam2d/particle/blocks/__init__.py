"""Maps of many particles in blocks that they share until one of them changes its own."""
