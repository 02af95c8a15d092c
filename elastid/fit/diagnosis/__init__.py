"""Diagnosis of a fit: hypotheses on causes of its residuals, one judge of them, status and notes."""
