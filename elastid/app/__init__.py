"""The application: command line, stages, runs and their output."""
