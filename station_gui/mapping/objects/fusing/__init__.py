"""Edges that were seen many times become one."""
