"""Readers of public logs: files in, observations out."""
