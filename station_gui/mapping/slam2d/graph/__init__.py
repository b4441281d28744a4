"""From relative poses to a trajectory: loop closures and their optimisation."""
