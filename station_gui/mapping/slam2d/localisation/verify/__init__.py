"""How well a place agrees with a map, beam by beam."""
