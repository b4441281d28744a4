"""From edge points to curves: which points follow one another, and which of them are worth learning."""
