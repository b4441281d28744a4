"""Simplified FastGNG (paper 1, section 3.2)."""
