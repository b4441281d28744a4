"""Devices as the drivers see them on the wire: for tests, and for trying the robot app without a robot."""
