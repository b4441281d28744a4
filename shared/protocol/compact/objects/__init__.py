"""The symbols of an object network, against those that the other side already has."""
