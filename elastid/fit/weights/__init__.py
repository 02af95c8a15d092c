"""Weights of the elements of a measured response: variances, their smoothing, full covariances, masks."""
