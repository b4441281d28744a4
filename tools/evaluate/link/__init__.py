"""What the link carries and what observations cost on it."""
