"""Modes of the identified model as values: a table row, names of springs, the robot drawn in motion."""
