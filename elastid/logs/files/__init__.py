"""Readers of log files, one format a file."""
