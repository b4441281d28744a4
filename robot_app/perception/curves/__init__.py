"""Creases, and the curves that edge points lie on."""
