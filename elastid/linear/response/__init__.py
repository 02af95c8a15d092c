"""Frequency responses of a LinearModel and their derivatives."""
