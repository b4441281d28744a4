"""The symbols of a scan, against its predictions."""
