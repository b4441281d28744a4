"""`robot-app calibrate`: measures what differs from one robot to the next and writes it into its robot.toml."""
