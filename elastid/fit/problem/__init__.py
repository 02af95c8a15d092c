"""The least-squares problem: residuals of measured and modelled responses, with their derivatives."""
