"""Independent work in several processes: same results whatever the number of workers, and a clean stop on Ctrl-C.

Processes of this machine, or, inside `on_dask(address)`, the workers of a Dask cluster, which must see the same files.
Processes are copies of one that has loaded what they need, where the system has such, and start anew elsewhere.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, MutableMapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Future,
    ProcessPoolExecutor,
    as_completed,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_all_start_methods, get_context, parent_process
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import Any, TypeAlias, TypeVar

from elastid.base.cluster import SCHEDULER, on_cluster, survived_on_cluster
from elastid.base.errors import ElastidError

Item = TypeVar("Item")
Value = TypeVar("Value")
Progress: TypeAlias = Callable[[int, int], None]


def silent(done: int, total: int) -> None:
    """Progress that is not shown."""


def unordered(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> Iterator[tuple[int, Value]]:
    """(index, function(item)) as they finish; in this process for one job or one item.

    function and items must pickle; the function goes to each worker once. What a worker that dies was at is done anew.
    On KeyboardInterrupt the workers are ended at once and what was yielded is kept.
    Raises ElastidError where workers die again and again.
    """
    progress(0, len(items))
    if min(jobs, len(items)) <= 1 and not SCHEDULER.get():
        for index, item in enumerate(items):
            yield index, function(item)
            progress(index + 1, len(items))
        return
    address = SCHEDULER.get()
    results = _by_cluster(address, function, items) if address else _by_processes(function, items, jobs)
    for done, result in enumerate(results, start=1):
        yield result
        progress(done, len(items))


def surviving(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> Iterator[tuple[int, Value | None]]:
    """`unordered`, always in other processes: a worker that dies costs the item that it was at, (index, None).

    For long work: each worker is a pool of its own. On a cluster the scheduler has then tried the item several times.
    """
    progress(0, len(items))
    address = SCHEDULER.get()
    found = survived_on_cluster(address, function, items) if address else _survived(function, items, jobs)
    for done, result in enumerate(found, start=1):
        yield result
        progress(done, len(items))


def resumed(
    function: Callable[[Item], Value],
    items: Sequence[Item],
    names: Sequence[str],
    finished: MutableMapping[str, Value],
    jobs: int,
    progress: Progress = silent,
) -> Iterator[tuple[int, Value]]:
    """`unordered`, resumed: values in `finished` under the names of the items come first, new ones are kept there."""
    there = [index for index, name in enumerate(names) if name in finished]
    todo = sorted(set(range(len(items))) - set(there))
    for index in there:
        yield index, finished[names[index]]

    def with_those(done: int, total: int) -> None:
        progress(done + len(there), total + len(there))

    for place, value in unordered(function, [items[index] for index in todo], jobs, with_those):
        finished[names[todo[place]]] = value
        yield todo[place], value


@dataclass(frozen=True)
class Execution:
    """How work is run: by `jobs` processes, telling progress(done, total), keeping what is finished in `checkpoint`.

    checkpoint: from where an interrupted computation of the same arguments is resumed; a dict, or a mapping that
    outlives the process. Results do not depend on any of the three.
    """

    jobs: int = 1
    progress: Progress = silent
    checkpoint: MutableMapping[str, Any] = field(default_factory=dict)

    def ordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """[function(item) for item in items]."""
        return ordered(function, items, self.jobs, self.progress)

    def unordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[tuple[int, Value]]:
        """(index, function(item)) as they finish."""
        return unordered(function, items, self.jobs, self.progress)

    def resumed(
        self, function: Callable[[Item], Value], items: Sequence[Item], names: Sequence[str]
    ) -> Iterator[tuple[int, Value]]:
        """`unordered`, resumed: what the checkpoint holds under the name of an item is taken from it."""
        return resumed(function, items, names, self.checkpoint, self.jobs, self.progress)


def load_for_workers(modules: Sequence[str]) -> None:
    """Begin to load modules in the process of which workers are copies, so that none of them loads them again.

    Once: where that process is there already, nothing changes. This process goes on meanwhile.
    """
    if start_method() != "forkserver":
        return
    from multiprocessing import forkserver, resource_tracker  # not on every system
    from signal import SIG_BLOCK, SIG_SETMASK, pthread_sigmask

    forkserver.set_forkserver_preload(["__main__", *modules])
    # Ctrl-C while it loads is for the parent alone; workers ignore it later. Tracker first: its start unblocks Ctrl-C.
    resource_tracker.ensure_running()
    before = pthread_sigmask(SIG_BLOCK, {SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        pthread_sigmask(SIG_SETMASK, before)


def start_method() -> str:
    """How workers come to be: as copies of a process that has loaded what they need, or anew, as on Windows."""
    return "forkserver" if "forkserver" in get_all_start_methods() else "spawn"


def _by_cluster(address: str, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[tuple[int, Value]]:
    """By a cluster; where all workers that have the function die, it goes to their successors."""
    left, deaths = dict(enumerate(items)), 0
    while left:
        try:
            with on_cluster(address, function) as submit:
                futures = {submit(item): index for index, item in left.items()}
                for future in as_completed(futures):
                    value = future.result()
                    del left[futures[future]]
                    yield futures[future], value
        except CancelledError as error:
            deaths += 1
            if deaths == _MOST_DEATHS:
                raise ElastidError(
                    f"all workers of the cluster at {address} died {deaths} times, perhaps for lack of memory; "
                    "give them more"
                ) from error


# So many times workers may die in one work; half as many go on each time, since most die for lack of memory.
_MOST_DEATHS = 4


def _by_processes(function: Callable[[Item], Value], items: Sequence[Item], jobs: int) -> Iterator[tuple[int, Value]]:
    """By processes of this machine, ended at once where anything goes wrong."""
    # Pickled here, so that an error of pickling is reported as such.
    work, left, deaths = pickle.dumps(function), dict(enumerate(items)), 0
    while left:
        pool = _pool(min(max(1, jobs >> deaths), len(left)), work)
        try:
            futures = _submitted(pool, left)
            for future in as_completed(futures):
                value = future.result()
                del left[futures[future]]
                yield futures[future], value
        except (BrokenProcessPool, BrokenPipeError) as error:
            deaths += 1
            if _main_is_unguarded():
                raise ElastidError(_UNGUARDED) from error
            if deaths == _MOST_DEATHS:
                raise ElastidError(
                    f"worker processes died {deaths} times, perhaps for lack of memory; try again with fewer --jobs"
                ) from error
        except BaseException:
            _end(pool)
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _submitted(pool: ProcessPoolExecutor, items: Mapping[int, Item]) -> dict[Future[Any], int]:
    """The items given to the workers, which are started by that.

    By a thread, which Ctrl-C does not reach: amid a start it would leave a worker that nobody knows and ends.
    """
    found: Future[dict[Future[Any], int]] = Future()

    def submit() -> None:
        try:
            found.set_result({pool.submit(_work, item): index for index, item in items.items()})
        except BaseException as error:
            found.set_exception(error)

    thread = Thread(target=submit)
    try:
        thread.start()
        return found.result()
    finally:
        if thread.is_alive():
            thread.join()


def _survived(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int
) -> Iterator[tuple[int, Value | None]]:
    """By pools of one process each; a pool whose process died is replaced."""
    work, waiting = pickle.dumps(function), iter(enumerate(items))
    running: dict[Future[Value], tuple[int, ProcessPoolExecutor]] = {}

    def take(pool: ProcessPoolExecutor) -> None:
        """The next item, or the end of the pool."""
        following = next(waiting, None)
        if following is None:
            pool.shutdown(wait=False)
        else:
            running[pool.submit(_work, following[1])] = following[0], pool

    try:
        for _ in range(min(jobs, len(items))):
            take(_pool(1, work))
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                index, pool = running.pop(future)
                died = isinstance(future.exception(), BrokenProcessPool)
                if died and _main_is_unguarded():
                    raise ElastidError(_UNGUARDED)
                take(_pool(1, work) if died else pool)
                yield index, None if died else future.result()
    finally:
        for _, pool in running.values():
            _end(pool)


def _pool(count: int, work: bytes) -> ProcessPoolExecutor:
    """Workers that leave Ctrl-C to the parent, which ends them; one BLAS thread each, set before NumPy is loaded."""
    return ProcessPoolExecutor(count, get_context(start_method()), initializer=_start_worker, initargs=(work,))


def _end(pool: ProcessPoolExecutor) -> None:
    """At once."""
    for process in list((pool._processes or {}).values()):
        process.terminate()
    pool.shutdown(wait=True, cancel_futures=True)


_UNGUARDED = (
    "a script that works in several processes is read by each of them: put what it does under "
    "if __name__ == '__main__':, or take jobs=1"
)


def _main_is_unguarded() -> bool:
    """Whether the script that runs would begin anew in every worker."""
    file = getattr(sys.modules.get("__main__"), "__file__", None)
    try:
        return file is not None and "__main__" not in Path(file).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False


def ordered(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> list[Value]:
    """[function(item) for item in items], computed by several processes."""
    return in_order(unordered(function, items, jobs, progress))


def in_order(results: Iterable[tuple[int, Value]]) -> list[Value]:
    """The values of (index, value), the first index first."""
    return [value for _, value in sorted(results, key=lambda result: result[0])]


# What this process works out of one item after the other, where it is a worker.
_FUNCTION: list[Callable[[Any], Any]] = []


def _start_worker(work: bytes) -> None:
    signal(SIGINT, SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()
    _FUNCTION.append(pickle.loads(work))


def _work(item: Any) -> Any:
    return _FUNCTION[-1](item)


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
