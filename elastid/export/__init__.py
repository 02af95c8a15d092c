"""The identified model for other tools, one target a file."""
