"""Searches over many poses: exhaustive near by, branch and bound on grids of several resolutions far off."""
