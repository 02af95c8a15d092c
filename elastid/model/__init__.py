"""The nonlinear elastic model of a robot, built symbolically, all on the link side."""
