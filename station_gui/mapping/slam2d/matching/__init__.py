"""From one scan to a pose: local maps of surfels, least-squares matching, branch and bound."""
