"""Algorithm 2 of paper 1: a line through most of the points."""
