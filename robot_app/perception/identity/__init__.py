"""Objects from frame to frame."""
