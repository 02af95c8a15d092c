"""The study of two axes, whose responses are not there yet."""

from plants.two_axes import study as study
