"""The fit of elastic parameters to frequency responses."""
