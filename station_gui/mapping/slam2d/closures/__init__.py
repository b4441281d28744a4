"""Which places seen before may be looked for, and what a closure must show to be believed, in either method."""
