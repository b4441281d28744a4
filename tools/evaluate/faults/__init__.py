"""Faults during a mission: what the robot does, how long it moves on, what the operator sees."""
