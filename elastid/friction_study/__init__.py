"""Friction by experiments of its own: torques, laws, bristles, warm-up, and a filter that follows it over a log."""
