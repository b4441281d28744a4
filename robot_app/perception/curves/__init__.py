"""Kernels that find creases and join edge points to curves."""
