"""Which of the parameters that a fit identifies a design is for."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import StudyError
from elastid.names import did_you_mean


def interest(names: Sequence[str], patterns: Sequence[str]) -> FloatArray:
    """Columns (n, s) of the identity that pick the parameters meant by names or patterns, all where there are none.

    StudyError for a pattern that stands for none of the names.
    """
    for pattern in patterns:
        if not any(fnmatchcase(name, pattern) for name in names):
            raise StudyError(f"the fit does not identify '{pattern}'; {did_you_mean(pattern, list(names))}")
    counts = [not patterns or any(fnmatchcase(name, pattern) for pattern in patterns) for name in names]
    return np.eye(len(names))[:, counts]
