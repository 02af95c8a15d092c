"""How many threads the linear algebra may use; asked before NumPy is loaded, and light enough for every command."""

from __future__ import annotations

import os


def one_blas_thread() -> None:
    """Ask every BLAS that is loaded from here on, in this process and its workers, for one thread."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(name, "1")
