"""The occupancy grid."""
