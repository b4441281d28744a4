"""Learners: from sample points to a network of nodes and connections."""
