"""Where a scan lies best on the last one: the encoder's own choice, so it may use floating point."""
