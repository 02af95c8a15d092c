"""The three ways in which a command can end badly; `cli` turns each into a message and an exit code."""

from __future__ import annotations


class ElastidError(Exception):
    """A failure that the user can act on: the message says what, where, why and what to do next."""

    exit_code = 1


class StudyError(ElastidError):
    """The study, its robot or the command line is wrong: exit code 2, nothing was computed."""

    exit_code = 2


class DataError(ElastidError):
    """The measured data cannot support what was asked: exit code 1, the data are left untouched."""


class FitError(ElastidError):
    """The identification failed or cannot be trusted: exit code 1."""
