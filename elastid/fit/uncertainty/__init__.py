"""Uncertainty of an estimate: covariance, jackknife, profile likelihood, bootstrap."""
