"""Worker processes of this machine: copies of one that has loaded what they need, ended at once on Ctrl-C.

They start from nothing where the system has no copies. Inside `lasting_workers()` they stay for the next work, with the
models that they have built.
"""

from __future__ import annotations

import logging
import os
import pickle
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from contextvars import ContextVar
from multiprocessing import get_all_start_methods, get_context, parent_process
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from typing import Any, TypeAlias

# A worker is a pool of one process, so that it is known which item a death costs and who has the function.
Worker: TypeAlias = ProcessPoolExecutor

# Workers at rest inside `lasting_workers()`, which any work inside takes from and returns to.
_AT_REST: ContextVar[list[Worker] | None] = ContextVar("workers at rest", default=None)


@contextmanager
def lasting_workers() -> Iterator[None]:
    """Inside, workers that have ended one work rest until the next."""
    at_rest: list[Worker] = []
    token = _AT_REST.set(at_rest)
    try:
        yield
    finally:
        _AT_REST.reset(token)
        _dismiss(at_rest)


def outcomes(
    work: bytes, items: Iterable[tuple[int, Any]], count: int
) -> Generator[tuple[int, Future[Any]], None, None]:
    """(index, future of function(item)) as they finish, by `count` workers; a worker that dies is replaced.

    work: the function, pickled, which goes to each worker once. Workers that are at an item when this ends are ended.
    """
    waiting = iter(items)
    lasting = _AT_REST.get()
    at_rest: list[Worker] = [] if lasting is None else lasting
    busy: list[Worker] = []
    running: dict[Future[Any], tuple[int, Worker]] = {}

    def give(worker: Worker, function: Callable[..., Any], *first: bytes) -> None:
        """The next item, or rest."""
        following = next(waiting, None)
        if following is None:
            if first == ():
                _submitted(worker, _forget)
            busy.remove(worker)
            at_rest.append(worker)
        else:
            running[_submitted(worker, function, *first, following[1])] = following[0], worker

    def join() -> None:
        """One worker more, who is given the function with its first item."""
        worker = _called(at_rest)
        busy.append(worker)
        give(worker, _begin, work)

    try:
        for _ in range(count):
            join()
        while running:
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                index, worker = running.pop(future)
                if has_died(future):
                    busy.remove(worker)
                    _end(worker)
                    yield index, future
                    join()
                else:
                    give(worker, _work)
                    yield index, future
    finally:
        for worker in busy:
            _end(worker)
        if lasting is None:
            _dismiss(at_rest)


def has_died(future: Future[Any]) -> bool:
    """True if the worker died at the item."""
    return isinstance(future.exception(), BrokenProcessPool)


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
    """How workers start: as copies of a process that has loaded their libraries, or from nothing, as on Windows."""
    return "forkserver" if "forkserver" in get_all_start_methods() else "spawn"


def _called(at_rest: list[Worker]) -> Worker:
    """A worker at rest that lives, or a new one: it leaves Ctrl-C to the parent, which ends it."""
    while at_rest:
        worker = at_rest.pop()
        if all(process.is_alive() for process in (worker._processes or {}).values()):
            return worker
        _end(worker)
    return ProcessPoolExecutor(1, get_context(start_method()), initializer=_start_worker)


def _submitted(worker: Worker, function: Callable[..., Any], *given: Any) -> Future[Any]:
    """The future of a call, which starts the worker; of one that is dead already it holds BrokenProcessPool.

    By a thread, which Ctrl-C does not reach: amid a start it would leave a worker that is never ended.
    """
    futures: list[Future[Any]] = []

    def submit() -> None:
        try:
            futures.append(worker.submit(function, *given))
        except BaseException as error:
            failed: Future[Any] = Future()
            # The pipe to a worker breaks where it dies while it starts.
            failed.set_exception(BrokenProcessPool(error) if isinstance(error, BrokenPipeError) else error)
            futures.append(failed)

    thread = Thread(target=submit)
    try:
        thread.start()
        thread.join()
        return futures[0]
    finally:
        if thread.is_alive():
            thread.join()


def _end(worker: Worker) -> None:
    """At once."""
    for process in list((worker._processes or {}).values()):
        process.terminate()
    worker.shutdown(wait=True, cancel_futures=True)


def _dismiss(workers: Sequence[Worker]) -> None:
    """Independently; wait for all."""
    for worker in workers:
        worker.shutdown(wait=False)
    for worker in workers:
        worker.shutdown(wait=True)


# What this process works out of one item after the other, where it is a worker.
_FUNCTION: list[Callable[[Any], Any]] = []


def _start_worker() -> None:
    signal(SIGINT, SIG_IGN)
    # Words of libraries are not for the terminal.
    logging.captureWarnings(True)
    logging.getLogger().addHandler(logging.NullHandler())
    Thread(target=_end_with_parent, daemon=True).start()


def _begin(work: bytes, item: Any) -> Any:
    """The first item of a work, and the function for all."""
    _forget()
    _FUNCTION.append(pickle.loads(work))
    return _work(item)


def _work(item: Any) -> Any:
    return _FUNCTION[-1](item)


def _forget() -> None:
    """The function, with all the data that it holds."""
    _FUNCTION.clear()


def _end_with_parent() -> None:
    """A worker whose parent was killed would wait for work for ever."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
