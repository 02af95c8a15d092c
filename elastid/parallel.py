"""Independent work in several processes: same results whatever the number of workers, and a clean stop on Ctrl-C."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from signal import SIG_IGN, SIGINT, signal
from typing import TypeAlias, TypeVar

Item = TypeVar("Item")
Value = TypeVar("Value")
Progress: TypeAlias = Callable[[int, int], None]


def silent(done: int, total: int) -> None:
    """A progress that nobody watches."""


def unordered(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> Iterator[tuple[int, Value]]:
    """(index, function(item)) as they finish; in this process for one job or one item.

    function and items must pickle. On KeyboardInterrupt the workers are ended at once and what was yielded is kept.
    """
    progress(0, len(items))
    if min(jobs, len(items)) <= 1:
        for index, item in enumerate(items):
            yield index, function(item)
            progress(index + 1, len(items))
        return
    # Workers leave Ctrl-C to the parent, which ends them; one BLAS thread each, set before NumPy is loaded there.
    pool = ProcessPoolExecutor(
        min(jobs, len(items)), mp_context=get_context("forkserver"), initializer=_ignore_interrupt
    )
    try:
        futures = {pool.submit(function, item): index for index, item in enumerate(items)}
        for done, future in enumerate(as_completed(futures), start=1):
            yield futures[future], future.result()
            progress(done, len(items))
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def ordered(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> list[Value]:
    """[function(item) for item in items], computed by several processes."""
    results = dict(unordered(function, items, jobs, progress))
    return [results[index] for index in range(len(items))]


def _ignore_interrupt() -> None:
    signal(SIGINT, SIG_IGN)


def one_blas_thread() -> None:
    """Ask every BLAS that is loaded from here on, in this process and its workers, for one thread."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(name, "1")
