"""The linear model in one configuration: equilibrium, linearisation, frequency response, modes."""
