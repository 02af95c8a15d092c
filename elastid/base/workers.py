"""Worker processes of this machine: copies of one preloaded process, terminated immediately on Ctrl-C.

They start from nothing where the system has no copies. Some stay for the next work, with the models that they have
built and the values that they have (`execution.persistent_workers`). Workers of a Dask cluster are asked by the
same messages (`base.execution`).

Large frozen arrays, and instances of `WorkerConstant`, which both keep, go to another process once: both ends of a pipe
know the values of the other one by names. A value that is deleted here is deleted there with the next work.
"""

import logging
import os
import pickle
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from io import BytesIO
from itertools import pairwise
from multiprocessing import Pipe, get_all_start_methods, get_context, parent_process
from multiprocessing.connection import Connection, wait
from signal import SIG_IGN, SIGINT, SIGTERM, getsignal, raise_signal, signal
from threading import Thread, current_thread, main_thread
from traceback import format_exc
from typing import Any
from weakref import WeakValueDictionary, finalize

import numpy as np

from elastid.base.large_arrays import MIN_MAPPED_BYTES, FileArray, move_to_file


class WorkerConstant:
    """Frozen dataclass that is sent to another process once, without its cached properties."""


class LostError(Exception):
    """The other end names a value that is not here, or no longer."""


_NAMES = dict[int, bytes]()  # by the identity of living objects
_VALUES = WeakValueDictionary[bytes, Any]()
_RECEIVED: ContextVar[dict[bytes, Any]] = ContextVar("values that come with a message")


class End:
    """This end of a pipe. keeps: True if values stay until the other end releases them."""

    def __init__(self, keeps: bool) -> None:
        self._known, self._keeps, self._held = set[bytes](), keeps, dict[bytes, Any]()

    def packed(self, value: Any, is_first: bool = False) -> bytearray:
        """Pickle a message. is_first: first message of a task, which releases values that were deleted here."""
        forgotten = [name for name in self._known if name not in _VALUES] if is_first else []
        message = _Message()
        pickler = _Pickler(message, self._known)
        pickler.dump(value)
        pickle.dump(forgotten, message)
        self._has(pickler.new, forgotten)
        return message

    def unpacked(self, message: bytes) -> Any:
        """Decode a message from the other end; raise LostError if it names a missing value."""
        file, received = BytesIO(message), dict[bytes, Any]()
        token = _RECEIVED.set(received)
        try:
            value = pickle.load(file)
        finally:
            _RECEIVED.reset(token)
        self._has(received, pickle.load(file))
        return value

    def _has(self, new: dict[bytes, Any], gone: list[bytes]) -> None:
        self._known.difference_update(gone)
        self._known.update(new)
        if self._keeps:
            self._held |= new
            for name in gone:
                self._held.pop(name, None)


class _Message(bytearray):
    """Bytes of a pickled value, sent without a copy: a BytesIO whose buffer is in use complains when it is freed."""

    write = bytearray.extend


class _Pickler(pickle.Pickler):
    """Replace values that the other end has by their names; new: values to send."""

    def __init__(self, message: _Message, sent: set[bytes]) -> None:
        super().__init__(message, pickle.HIGHEST_PROTOCOL)
        self._known, self.new = sent, dict[bytes, Any]()

    def reducer_override(self, value: Any) -> Any:
        """Name of a value that the other end has, with names of its parts if it stays there."""
        parts: tuple[Any, ...]
        if isinstance(value, WorkerConstant):
            parts = (_construct, type(value), {f.name: getattr(value, f.name) for f in fields(value)})  # type: ignore[arg-type]
        elif not isinstance(value, np.ndarray) or value.flags.writeable or value.nbytes < MIN_MAPPED_BYTES:
            return NotImplemented
        elif type(value) is np.ndarray and value.flags.owndata and not value.dtype.hasobject:
            parts = (_frozen, value.view())
        elif type(value) is FileArray and hasattr(value, "room"):
            parts = (move_to_file, value.folder, np.array(value))
        else:
            return NotImplemented
        name = _NAMES.get(id(value)) or _register(os.urandom(8), value)
        if name in self._known:
            return _recall, (name,)
        self.new[name] = value
        return _receive, (name, *parts)


def _register(name: bytes, value: Any) -> bytes:
    _NAMES[id(value)], _VALUES[name] = name, value
    finalize(value, _NAMES.pop, id(value)).atexit = False
    return name


def _recall(name: bytes) -> Any:
    value = _VALUES.get(name)
    if value is None:
        raise LostError
    return value


def _receive(name: bytes, make: Callable[..., Any], *parts: Any) -> Any:
    value = _VALUES.get(name)  # as in a worker that is a thread of this process
    if value is None:
        _register(name, value := make(*parts))
    _RECEIVED.get()[name] = value
    return value


def _construct(of: type[Any], values: dict[str, Any]) -> Any:
    value = object.__new__(of)
    value.__dict__.update(values)
    return value


def _frozen(values: Any) -> Any:
    values = values.copy(order="K")  # an unpickled array owns no memory, and would have no name
    values.flags.writeable = False
    return values


@dataclass(frozen=True, eq=False)
class Worker:
    """A process, and this end of the pipe to it, which alone has the other end: whenever it dies, the pipe ends.

    A pool of the standard library waits for ever where a process dies amid an answer (CPython, ProcessPoolExecutor:
    every process of the pool and its parent keep the pipe of the answers open).  process: of this machine, or what does
    as one; of it start, terminate, join, is_alive and pid are used.  place: among its fellows.
    """

    process: Any
    pipe: Connection
    place: int
    end: End = field(default_factory=lambda: End(keeps=False))


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


def outcomes(
    function: Callable[[Any], Any],
    items: Sequence[tuple[int, Any]],
    count: int,
    at_home: bool = False,
    new: Callable[[Connection, int], Any] | None = None,
    lasting: list[Worker] | None = None,
) -> Generator[tuple[int, Outcome], None, None]:
    """Yield (index, outcome of function(item)) as they finish, by `count` workers; replaces a worker that dies.

    The function goes to each worker once.  at_home: each item to the worker of its place, neighbours to the same one;
    else to the next that is free.  new: the process of a worker, not yet started, by its end of the pipe and its place.
    lasting: those at rest, which work again and rest again behind it.  Workers that are at an item when this ends are
    ended.
    """
    ends = [len(items) * i // count for i in range(count + 1)] if at_home else [0, len(items)]
    waiting = [deque(items[first:last]) for first, last in pairwise(ends)]
    at_rest = [] if lasting is None else lasting
    workers: list[Worker] = []
    busy: dict[Connection, tuple[int, Worker]] = {}

    def give(worker: Worker, is_new: bool = False) -> Iterator[tuple[int, Outcome]]:
        """Send the next item, or rest; if the worker has died, return the outcome of the item."""
        queue = waiting[worker.place % len(waiting)]
        following = queue.popleft() if queue else None
        message = REST if following is None else worker.end.packed((function if is_new else None, following[1]), is_new)
        if following is None:
            at_rest.append(worker)
        else:
            busy[worker.pipe] = following[0], worker
        try:
            worker.pipe.send_bytes(message)
        except (BrokenPipeError, ConnectionResetError):
            if following is not None:
                yield from replace(worker.pipe)

    def replace(pipe: Connection) -> Iterator[tuple[int, Outcome]]:
        """Yield the outcome of a worker that died at an item; another worker takes the next item."""
        index, worker = busy.pop(pipe)
        end(worker)
        yield index, Outcome(died=True)
        yield from give(_call(at_rest, workers, worker.place, new or _local), is_new=True)

    try:
        for worker in [_call(at_rest, workers, i, new or _local) for i in range(count)]:
            yield from give(worker, is_new=True)
        while busy:
            ready = wait(list(busy))
            for pipe in [pipe for pipe in busy if pipe in ready]:
                try:
                    outcome: Outcome = busy[pipe][1].end.unpacked(pipe.recv_bytes())
                except (EOFError, ConnectionResetError, LostError):
                    yield from replace(pipe)
                else:
                    index, worker = busy.pop(pipe)
                    yield from give(worker)
                    yield index, outcome
    finally:
        for worker in workers:
            if worker not in at_rest:
                end(worker)
        if lasting is None:
            dismiss(at_rest)


def load_for_workers(modules: Sequence[str]) -> None:
    """Preload modules in the fork server, so that workers start with imported modules.

    Returns at once. Has no effect if the fork server runs already.
    """
    if start_method() != "forkserver":
        return
    from multiprocessing import forkserver, resource_tracker  # not on every system
    from signal import SIG_BLOCK, SIG_SETMASK, pthread_sigmask

    forkserver.set_forkserver_preload(["__main__", *modules])
    # Ctrl-C while it loads is for the parent alone; workers ignore it later. Tracker first: its start unblocks Ctrl-C.
    resource_tracker.ensure_running()
    old_mask = pthread_sigmask(SIG_BLOCK, {SIGINT})
    try:
        forkserver.ensure_running()
    finally:
        pthread_sigmask(SIG_SETMASK, old_mask)


def start_method() -> str:
    """Return how workers start: as copies of a process with loaded libraries, or from nothing, as on Windows."""
    return "forkserver" if "forkserver" in get_all_start_methods() else "spawn"


def _call(at_rest: list[Worker], function: list[Worker], place: int, new: Callable[..., Any]) -> Worker:
    """Take an idle worker that lives, or start a new one; it is among the workers from its first moment."""
    for worker in [worker for worker in at_rest if worker.place == place]:
        at_rest.remove(worker)
        function.append(worker)
        if worker.process.is_alive():
            return worker
        end(worker)
    with _signals_deferred():
        _start(function, place, new)
    return function[-1]


@contextmanager
def _signals_deferred() -> Iterator[None]:
    """Postpone Ctrl-C until the end: during a start it would leave a worker that never ends."""
    if current_thread() is not main_thread():  # which Ctrl-C does not reach
        yield
        return
    handlers, signals = {number: getsignal(number) for number in (SIGINT, SIGTERM)}, list[int]()
    acting = {number: handler for number, handler in handlers.items() if callable(handler)}
    for number in acting:
        signal(number, lambda number, _: signals.append(number))
    try:
        yield
    finally:
        for number, handler in acting.items():
            signal(number, handler)
    for again in signals:
        raise_signal(again)


def _local(pipe: Connection, place: int) -> Any:
    context: Any = get_context(start_method())
    return context.Process(target=_serve, args=(pipe,))


def _start(function: list[Worker], place: int, new: Callable[..., Any]) -> None:
    ours, theirs = Pipe()
    process = new(theirs, place)
    function.append(Worker(process, ours, place))
    # The pipe to a worker that starts from nothing breaks where it dies meanwhile, and so will its own.
    with suppress(BrokenPipeError):
        process.start()
    if new is _local:
        theirs.close()


def end(worker: Worker) -> None:
    """End a worker at once."""
    worker.pipe.close()
    if worker.process.pid is not None:
        worker.process.terminate()
        worker.process.join()


def dismiss(workers: Sequence[Worker]) -> None:
    """Dismiss workers independently and wait for all."""
    for worker in workers:
        worker.pipe.close()
    for worker in workers:
        worker.process.join()


# Message to a worker that has nothing to do: the function goes, with all the data that it holds.
REST = b""


def _serve(pipe: Connection) -> None:
    """Run a worker: answer each item until the pipe ends. Ctrl-C is left to the parent, which terminates it."""
    signal(SIGINT, SIG_IGN)
    # Words of libraries are not for the terminal.
    logging.captureWarnings(True)
    logging.getLogger().addHandler(logging.NullHandler())
    Thread(target=_end_with_parent, daemon=True).start()
    served = WorkerState()
    with suppress(EOFError, ConnectionResetError, LostError):
        while True:
            answer = served.answer(pipe.recv_bytes())
            if answer is not None:
                pipe.send_bytes(answer)


class WorkerState:
    """The function of a work, and the values that came with it, in a worker."""

    def __init__(self) -> None:
        self._end = End(keeps=True)
        self._function: Callable[[Any], Any] | None = None

    def answer(self, message: bytes) -> Any:
        """Return the packed outcome of a message's item; None for a worker without further work."""
        if message == REST:
            self._function = None
            return None
        try:
            function, item = self._end.unpacked(message)
            if function is not None:
                self._function = function
            if self._function is None:  # the first item, with which it came, went to another process
                raise LostError
            return self._end.packed(Outcome(self._function(item)))
        except LostError:
            raise
        except Exception as error:
            failure = Outcome(error=error, trace=format_exc())
        try:
            return self._end.packed(failure)
        except Exception:  # an error with a value that does not pickle
            return self._end.packed(Outcome(error=RuntimeError(failure.trace)))


def _end_with_parent() -> None:
    """End this worker if its parent was killed."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
