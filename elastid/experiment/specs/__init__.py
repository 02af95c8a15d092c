"""The sections of a study that describe an experiment: simulated, recorded, responses."""
