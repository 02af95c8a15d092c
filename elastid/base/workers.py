"""Worker processes of this machine: copies of one preloaded process, terminated immediately on Ctrl-C.

Systems without a fork server start each worker as a new interpreter. Idle workers, with the models that they have built
and the values that they have received, remain for the next work inside `execution.persistent_workers`. Workers of a
Dask cluster (`base.dask_cluster`) receive the same messages (`base.messages`).
"""

import logging
import os
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from itertools import pairwise
from multiprocessing import Pipe, get_all_start_methods, get_context, parent_process
from multiprocessing.connection import Connection, wait
from signal import SIG_IGN, SIGINT, SIGTERM, getsignal, raise_signal, signal
from threading import Thread, current_thread, main_thread
from traceback import format_exc
from typing import Any

from elastid.base.messages import LostError, PipeEnd


@dataclass(frozen=True, eq=False)
class Worker:
    """A process and this end of its pipe. No other process has the other end: the pipe ends when the worker dies.

    A pool of the standard library waits for ever if a process dies while it sends an answer, since all its processes
    keep the pipe of the answers open (CPython, ProcessPoolExecutor).  process: a Process, or an object with its
    methods start, terminate, join, is_alive and its pid.  index: number of the worker, from 0.
    """

    process: Any
    pipe: Connection
    index: int
    end: PipeEnd = field(default_factory=lambda: PipeEnd(keeps=False))


@dataclass(frozen=True)
class Outcome:
    """Outcome of an item: its value, or the error that it raised with the traceback; neither if the worker died."""

    value: Any = None
    error: Exception | None = None
    trace: str = ""
    died: bool = False

    @property
    def result(self) -> Any:
        """Value of the item; raises its error."""
        if self.error is not None:
            raise self.error from RuntimeError(f"in a worker:\n{self.trace}")
        return self.value


def outcomes(
    function: Callable[[Any], Any], items: Sequence[tuple[int, Any]], count: int, has_affinity: bool = False,
    new_process: Callable[[Connection, int], Any] | None = None, persistent: list[Worker] | None = None
) -> Generator[tuple[int, Outcome], None, None]:  # fmt: skip
    """Yield (index, outcome of function(item)) as they finish, by `count` workers; a worker that dies is replaced.

    The function is sent to each worker once.  has_affinity: the i-th worker computes the i-th block of neighbouring
    items; otherwise each item goes to the next idle worker.  new_process: returns the process of a worker, not yet
    started, from its end of the pipe and its index.  persistent: idle workers, which are used and returned; None to
    dismiss all workers at the end.  If the generator is closed, workers with an unfinished item are terminated.
    """
    bounds = [len(items) * i // count for i in range(count + 1)] if has_affinity else [0, len(items)]
    queues = [deque(items[first:last]) for first, last in pairwise(bounds)]
    pool = _Pool(function, queues, new_process or _local_process, [] if persistent is None else persistent)
    try:
        for worker in [pool.take_worker(i) for i in range(count)]:
            yield from pool.send_next(worker, is_new=True)
        while pool.busy:
            ready = wait(list(pool.busy))
            for pipe in [pipe for pipe in pool.busy if pipe in ready]:
                yield from pool.receive(pipe)
    finally:
        for worker in pool.workers:
            if worker not in pool.idle:
                terminate(worker)
        if persistent is None:
            dismiss(pool.idle)


@dataclass(eq=False)
class _Pool:
    """Workers of one call of `outcomes`, and its remaining items.

    queues: of items with their indices, one for all workers or one for each.  idle: workers without an item, of this
    and of earlier calls.  workers: of this call.  busy: worker and index of its item by pipe.
    """

    function: Callable[[Any], Any]
    queues: Sequence[deque[tuple[int, Any]]]
    new_process: Callable[[Connection, int], Any]
    idle: list[Worker]
    workers: list[Worker] = field(default_factory=list)
    busy: dict[Connection, tuple[int, Worker]] = field(default_factory=dict)

    def send_next(self, worker: Worker, is_new: bool = False) -> Iterator[tuple[int, Outcome]]:
        """Send the worker its next item, or make it idle; yield the outcome of an item if the worker has died."""
        queue = self.queues[worker.index % len(self.queues)]
        if queue:
            index, item = queue.popleft()
            message = worker.end.pack((self.function if is_new else None, item), is_new)
            self.busy[worker.pipe] = index, worker
        else:
            message = bytearray(REST)
            self.idle.append(worker)
        try:
            worker.pipe.send_bytes(message)
        except (BrokenPipeError, ConnectionResetError):
            if worker.pipe in self.busy:
                yield from self.replace(worker.pipe)

    def receive(self, pipe: Connection) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcome that a pipe has; its worker receives the next item."""
        try:
            outcome: Outcome = self.busy[pipe][1].end.unpack(pipe.recv_bytes())
        except (EOFError, ConnectionResetError, LostError):
            yield from self.replace(pipe)
        else:
            index, worker = self.busy.pop(pipe)
            yield from self.send_next(worker)
            yield index, outcome

    def replace(self, pipe: Connection) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcome of a worker that died at an item; its successor receives the next item."""
        index, worker = self.busy.pop(pipe)
        terminate(worker)
        yield index, Outcome(died=True)
        yield from self.send_next(self.take_worker(worker.index), is_new=True)

    def take_worker(self, index: int) -> Worker:
        """Take the idle worker of an index if it lives, or start a new one; append it to `workers` before it runs."""
        for worker in [worker for worker in self.idle if worker.index == index]:
            self.idle.remove(worker)
            self.workers.append(worker)
            if worker.process.is_alive():
                return worker
            terminate(worker)
        with _signals_deferred():
            parent_end, worker_end = Pipe()
            process = self.new_process(worker_end, index)
            self.workers.append(Worker(process, parent_end, index))
            # If a new interpreter dies during its start, this pipe and later the worker's pipe break.
            with suppress(BrokenPipeError):
                process.start()
            if self.new_process is _local_process:
                worker_end.close()
        return self.workers[-1]


def load_for_workers(modules: Sequence[str]) -> None:
    """Start to preload modules in the fork server, so that workers start with them; no effect if it runs already."""
    if start_method() != "forkserver":
        return
    from multiprocessing import forkserver, resource_tracker  # not on every system
    from signal import SIG_BLOCK, SIG_SETMASK, pthread_sigmask

    forkserver.set_forkserver_preload(["__main__", *modules])
    # During loading only the parent handles Ctrl-C. The tracker starts first, because its start unblocks Ctrl-C.
    resource_tracker.ensure_running()
    old_mask = pthread_sigmask(SIG_BLOCK, {SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        pthread_sigmask(SIG_SETMASK, old_mask)


def start_method() -> str:
    """Return the start method: copies of a process with loaded libraries, or new interpreters, as on Windows."""
    return "forkserver" if "forkserver" in get_all_start_methods() else "spawn"


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Postpone Ctrl-C until the end: during a start it would leave a worker that never ends."""
    if current_thread() is not main_thread():  # signals reach the main thread alone
        yield
        return
    signals = []
    handlers = {number: getsignal(number) for number in (SIGINT, SIGTERM) if callable(getsignal(number))}
    for number in handlers:
        signal(number, lambda number, _: signals.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal(number, handler)
    for postponed in signals:
        raise_signal(postponed)


def _local_process(pipe: Connection, index: int) -> Any:
    context: Any = get_context(start_method())
    return context.Process(target=_serve, args=(pipe,))


def terminate(worker: Worker) -> None:
    """Terminate a worker and wait for its end."""
    worker.pipe.close()
    if worker.process.pid is not None:
        worker.process.terminate()
        worker.process.join()


def dismiss(workers: Sequence[Worker]) -> None:
    """Close the pipes of all workers, at which they end, and wait for them."""
    for worker in workers:
        worker.pipe.close()
    for worker in workers:
        worker.process.join()


# Message to a worker that becomes idle: it deletes the function, with all its data.
REST = b""


def _serve(pipe: Connection) -> None:
    """Run a worker: answer each item until the pipe ends."""
    signal(SIGINT, SIG_IGN)  # the parent handles Ctrl-C and terminates its workers
    # Warnings of libraries do not go to the terminal.
    logging.captureWarnings(True)
    logging.getLogger().addHandler(logging.NullHandler())
    Thread(target=_end_with_parent, daemon=True).start()
    state = WorkerState()
    with suppress(EOFError, ConnectionResetError, LostError):
        while True:
            answer = state.answer(pipe.recv_bytes())
            if answer is not None:
                pipe.send_bytes(answer)


class WorkerState:
    """State of a worker: its function and the values that it has received."""

    def __init__(self) -> None:
        self._end = PipeEnd(keeps=True)
        self._function: Callable[[Any], Any] | None = None

    def answer(self, message: bytes) -> Any:
        """Return the packed outcome of an item, None for REST; LostError if the function went to a dead process."""
        if message == REST:
            self._function = None
            return None
        try:
            function, item = self._end.unpack(message)
            if function is not None:
                self._function = function
            if self._function is None:
                raise LostError
            return self._end.pack(Outcome(self._function(item)))
        except LostError:
            raise
        except Exception as error:
            failure = Outcome(error=error, trace=format_exc())
        try:
            return self._end.pack(failure)
        except Exception:  # an error with a value that does not pickle
            return self._end.pack(Outcome(error=RuntimeError(failure.trace)))


def _end_with_parent() -> None:
    """End this worker if its parent was killed."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
