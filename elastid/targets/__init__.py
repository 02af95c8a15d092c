"""The fitted model for other tools, one target a file."""
