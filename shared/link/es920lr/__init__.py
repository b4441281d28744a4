"""The EASEL ES920LR: a LoRa module for Japan's 920 MHz band, on a serial line."""
