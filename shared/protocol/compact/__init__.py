"""Profile COMPACT: observations predicted from what the other side already has, and only the surprise sent."""
