"""What a measured response says about its own measurement: exchanged channels, signs, quality."""
