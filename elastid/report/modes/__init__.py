"""Modes of the identified model: rows of a table, and the robot drawn in motion."""
