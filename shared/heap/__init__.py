"""A binary heap for searches in kernels."""
