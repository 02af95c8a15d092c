"""Plants, studies and values that tests of several rooms share."""
