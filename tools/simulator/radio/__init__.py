"""The air between radio modules, and the ports they hang on."""
