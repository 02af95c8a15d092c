"""Experimental modal analysis: poles over model orders, their selection, shapes, intervals and state-space models."""
