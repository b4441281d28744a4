"""Wi-Fi and LoRa as one link that loses nothing when it changes from one to the other."""
