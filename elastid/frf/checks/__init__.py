"""Checks of a measurement: records that fit together, separate inputs, exchanged channels and signs, quality."""
