"""Commands that keep the tool on its path: motor references, torque feedforward, friction compensation."""
