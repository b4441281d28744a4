"""Measures what docs/results.md says about 2D SLAM, draws its maps and writes its tables."""
