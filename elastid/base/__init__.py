"""Shared by every room: array types, errors, units, sections of a study, execution in processes."""
