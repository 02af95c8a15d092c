"""Modes of a measured structure: poles over orders, which of them are modes, shapes, intervals, state-space models."""
