"""Foreign bytes for everything that reads what comes from outside."""
