"""Kernels on a network of nodes and connections, which the learners and the post-processing share."""
