"""How sure an estimate is: covariance, jackknife, profile likelihood, bootstrap, and what it means for modes."""
