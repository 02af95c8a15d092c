"""How good the identified model is on what it was not fitted to."""
