"""Branch and bound on grids of several resolutions."""
