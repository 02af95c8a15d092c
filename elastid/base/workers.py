"""Worker processes of this machine: copies of one that has loaded what they need, ended at once on Ctrl-C.

They start from nothing where the system has no copies. Inside `lasting_workers()` they stay for the next work, with the
models that they have built.
"""

from __future__ import annotations

import logging
import os
import pickle
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from multiprocessing import Pipe, get_all_start_methods, get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from signal import SIG_IGN, SIGINT, signal
from threading import Thread
from traceback import format_exc
from typing import Any


@dataclass(frozen=True, eq=False)
class Worker:
    """A process, and this end of the pipe to it, which alone has the other end: whenever it dies, the pipe ends.

    A pool of the standard library waits for ever where a process dies amid an answer (CPython, `ProcessPoolExecutor`:
    every process of the pool and its parent keep the pipe of the answers open).
    """

    process: BaseProcess
    pipe: Connection


@dataclass(frozen=True)
class Outcome:
    """The end of an item: its value, or the error that it raised, or neither where the worker died."""

    value: Any = None
    error: Exception | None = None
    trace: str = ""
    died: bool = False

    @property
    def result(self) -> Any:
        """The value; raises the error."""
        if self.error is not None:
            raise self.error from RuntimeError(f"in a worker:\n{self.trace}")
        return self.value


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


def outcomes(work: bytes, items: Iterable[tuple[int, Any]], count: int) -> Generator[tuple[int, Outcome], None, None]:
    """(index, outcome of function(item)) as they finish, by `count` workers; a worker that dies is replaced.

    work: the function, pickled, which goes to each worker once. Workers that are at an item when this ends are ended.
    """
    waiting = iter(items)
    lasting = _AT_REST.get()
    at_rest: list[Worker] = [] if lasting is None else lasting
    called: list[Worker] = []
    busy: dict[Connection, tuple[int, Worker]] = {}

    def give(worker: Worker, first: bytes | None = None) -> Iterator[tuple[int, Outcome]]:
        """The next item, or rest; of a worker that is dead already, the outcome of the item."""
        following = next(waiting, None)
        if following is None:
            at_rest.append(worker)
        else:
            busy[worker.pipe] = following[0], worker
        try:
            worker.pipe.send_bytes(_REST if following is None else pickle.dumps((first, following[1])))
        except (BrokenPipeError, ConnectionResetError):
            if following is not None:
                yield from replace(worker.pipe)

    def replace(pipe: Connection) -> Iterator[tuple[int, Outcome]]:
        """The outcome of the item at which a worker died; another takes the next one."""
        index, worker = busy.pop(pipe)
        end(worker)
        yield index, Outcome(died=True)
        yield from give(_call(at_rest, called), work)

    try:
        for worker in [_call(at_rest, called) for _ in range(count)]:
            yield from give(worker, work)
        while busy:
            ready = wait(list(busy))
            for pipe in [pipe for pipe in busy if pipe in ready]:
                try:
                    outcome: Outcome = pickle.loads(pipe.recv_bytes())
                except (EOFError, ConnectionResetError):
                    yield from replace(pipe)
                else:
                    index, worker = busy.pop(pipe)
                    yield from give(worker)
                    yield index, outcome
    finally:
        for worker in called:
            if worker not in at_rest:
                end(worker)
        if lasting is None:
            _dismiss(at_rest)


def new_worker() -> Worker:
    """A worker that nobody else asks; whoever called it has to `end` it."""
    return _call([], [])


def answers(given: Mapping[int, tuple[Worker, bytes]]) -> dict[int, Outcome]:
    """Outcomes of a message to each `new_worker`: pickled (function, item), or (None, item) for the same function."""
    known = dict[int, Outcome]()
    for i, (worker, message) in given.items():
        try:
            worker.pipe.send_bytes(message)
        except (BrokenPipeError, ConnectionResetError):
            known[i] = Outcome(died=True)
    for i, (worker, _) in given.items():
        if i not in known:
            try:
                known[i] = pickle.loads(worker.pipe.recv_bytes())
            except (EOFError, ConnectionResetError):
                known[i] = Outcome(died=True)
    return known


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


def _call(at_rest: list[Worker], called: list[Worker]) -> Worker:
    """A worker at rest that lives, or a new one; among those called, from its first moment.

    New ones start in a thread, which Ctrl-C does not reach: amid a start it would leave a worker that is never ended.
    """
    while at_rest:
        worker = at_rest.pop()
        called.append(worker)
        if worker.process.is_alive():
            return worker
        end(worker)
    errors: list[BaseException] = []

    def start() -> None:
        try:
            _start(called)
        except BaseException as error:
            errors.append(error)

    thread = Thread(target=start)
    try:
        thread.start()
        thread.join()
    finally:
        if thread.is_alive():
            thread.join()
    if errors:
        raise errors[0]
    return called[-1]


def _start(called: list[Worker]) -> None:
    ours, theirs = Pipe()
    context: Any = get_context(start_method())
    process = context.Process(target=_serve, args=(theirs,))
    called.append(Worker(process, ours))
    # The pipe to a worker that starts from nothing breaks where it dies meanwhile, and so will its own.
    with suppress(BrokenPipeError):
        process.start()
    theirs.close()


def end(worker: Worker) -> None:
    """A worker ends at once."""
    if worker.process.pid is not None:
        worker.process.terminate()
        worker.process.join()
    worker.pipe.close()


def _dismiss(workers: Sequence[Worker]) -> None:
    """Independently; wait for all."""
    for worker in workers:
        worker.pipe.close()
    for worker in workers:
        worker.process.join()


# Message to a worker that has nothing to do: the function goes, with all the data that it holds.
_REST = b""


def _serve(pipe: Connection) -> None:
    """Work, in a worker: an answer to each item, until the pipe ends; it leaves Ctrl-C to the parent, which ends it."""
    signal(SIGINT, SIG_IGN)
    # Words of libraries are not for the terminal.
    logging.captureWarnings(True)
    logging.getLogger().addHandler(logging.NullHandler())
    Thread(target=_end_with_parent, daemon=True).start()
    function: Callable[[Any], Any] | None = None
    while True:
        try:
            message = pipe.recv_bytes()
        except (EOFError, ConnectionResetError):
            return
        if message == _REST:
            function = None
        else:
            function, answer = _answered(function, message)
            pipe.send_bytes(answer)


def _answered(function: Callable[[Any], Any] | None, message: bytes) -> tuple[Callable[[Any], Any] | None, bytes]:
    """The function from now on, and the outcome of the message's item, pickled."""
    try:
        work, item = pickle.loads(message)
        function = function if work is None else pickle.loads(work)
        assert function is not None, "the first item comes with the function"
        return function, pickle.dumps(Outcome(function(item)))
    except Exception as error:
        failed = Outcome(error=error, trace=format_exc())
    try:
        return function, pickle.dumps(failed)
    except Exception:  # an error that holds what does not pickle
        return function, pickle.dumps(Outcome(error=RuntimeError(failed.trace)))


def _end_with_parent() -> None:
    """A worker whose parent was killed would go on with its item."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
