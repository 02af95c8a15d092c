"""Frequency responses with their covariance, from records."""
