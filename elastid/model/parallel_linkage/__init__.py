"""Robots with loops: closure, rods, and the two formulations, constrained and minimal, side by side."""
