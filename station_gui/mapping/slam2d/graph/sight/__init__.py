"""Whether one visit looked through what another saw."""
