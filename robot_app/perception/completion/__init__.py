"""What learning has left out of a curve, drawn after all."""
