"""Local solves and multistart for any LeastSquares problem; they know neither robot nor response."""
