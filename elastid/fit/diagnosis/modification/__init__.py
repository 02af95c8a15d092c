"""Modification indices: what a fit held or read wrongly, by the score test and by other readings of the responses."""
