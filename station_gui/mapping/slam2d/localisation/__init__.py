"""Where the robot is in a map that is there already."""
