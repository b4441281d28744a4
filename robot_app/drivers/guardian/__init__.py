"""A process of its own that cuts the motors when the app dies or hangs."""
