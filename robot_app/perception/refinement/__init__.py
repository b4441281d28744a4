"""Kernels that turn a learned network into outlines."""
