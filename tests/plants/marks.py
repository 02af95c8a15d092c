"""Cases of parametrised tests that are slow, and seeds of which the first alone runs by default."""

import shutil

import pytest


def slow(*values: object):
    """The case of a parametrised test, marked slow."""
    return pytest.param(*values, marks=pytest.mark.slow)


needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
SEEDS = [0, slow(1), slow(2)]
