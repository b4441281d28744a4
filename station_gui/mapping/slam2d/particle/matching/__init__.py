"""Matching of a scan on the map of one particle."""
