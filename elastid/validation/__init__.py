"""Validation of the identified model: errors on left-out configurations, residual tests, replays, comparison."""
