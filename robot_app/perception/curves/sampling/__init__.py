"""Curves smoothed, judged and sampled."""
