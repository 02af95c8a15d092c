"""Logs of a real robot: reading, alignment, repair, and conversion to records."""
