"""How much each element of a measured response counts: variances, their smoothing, full covariances, factors."""
