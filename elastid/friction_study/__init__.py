"""Friction studies: friction torques, static and presliding models, warm-up, and a filter that tracks friction."""
