"""Time simulation of the nonlinear elastic model in closed loop."""
