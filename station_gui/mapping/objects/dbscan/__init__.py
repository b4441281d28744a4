"""Algorithm 1 of paper 1: density-based clustering of lines."""
