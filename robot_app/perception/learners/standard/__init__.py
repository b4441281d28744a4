"""Standard growing neural gas (Fritzke 1995)."""
