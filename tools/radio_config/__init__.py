"""`radio-config`: sets up the radio modules and measures what they carry."""
