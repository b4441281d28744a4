"""Two LoRa modules of each side as one link."""
