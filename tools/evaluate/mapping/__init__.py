"""How good a map of objects is: against the true boxes of the room, and against the maps of other trials."""
