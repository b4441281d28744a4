"""Kernels that grow and refine a network of nodes and connections."""
