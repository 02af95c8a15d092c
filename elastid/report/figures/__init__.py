"""Figures of a report: functions from values to a matplotlib Figure; drawings.py is the catalogue."""
