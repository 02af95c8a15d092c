"""The figures of a report, one theme a file; drawings.py is the catalogue. Values in, matplotlib Figure out."""
