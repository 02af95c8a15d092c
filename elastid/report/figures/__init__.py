"""The figures of a report, one subject a file. Pure matplotlib: values in, Figure out."""
