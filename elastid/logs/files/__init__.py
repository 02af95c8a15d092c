"""Readers of log files, by format."""
