"""Figures and the page that answer the user's questions."""
