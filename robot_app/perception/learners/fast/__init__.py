"""FastGNG (Kubota): growth by mini-batches."""
