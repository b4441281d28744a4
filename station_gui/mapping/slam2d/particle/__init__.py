"""SLAM by a Rao-Blackwellized particle filter."""
