"""The application: command line, stages, runs and what people see of them."""
