"""Friction identified: levels of passes, the law that goes through them, and what slides before it slides."""
