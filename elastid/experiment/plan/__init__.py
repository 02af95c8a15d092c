"""The plan of an experiment: torque spectra, movement, references. It imports no model."""
