"""The figures of a report, one subject a file; drawings.py is the catalogue. Values in, matplotlib Figure out."""
