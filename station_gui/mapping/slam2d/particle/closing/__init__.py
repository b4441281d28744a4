"""Loops of the particles' common way: found, verified, and closed by bending the paths."""
