"""Which configurations to measure, how often and with which powers, and what that is expected to tell."""
