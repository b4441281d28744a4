"""A sparse system of 3 × 3 blocks, ordered, factored and solved in bounded shares of work."""
