"""Experiments: their specs, the plan of configurations, realisations and torques, and the simulated rig."""
