"""Independent work in processes or on a Dask cluster: the same results whatever their number, a clean end on Ctrl-C.

Processes of this machine, or, inside `on_dask(address)`, the workers of a Dask cluster, which must see the same files:
they are asked by the messages of `base.workers`, in tasks.
"""

import gc
import sys
from collections.abc import Callable, Generator, Iterator, MutableMapping, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from typing import Any, TypeAlias, TypeVar
from uuid import uuid4

from elastid.base.errors import ElastidError, installed
from elastid.base.workers import End, LostError, Outcome, Worker, WorkerState, dismiss, outcomes

Item = TypeVar("Item")
Value = TypeVar("Value")

Progress: TypeAlias = Callable[[int, int], None]

# Seconds for a Dask scheduler to answer, and to look whether a worker is there; for the first one to start again.
ANSWER_S = 10.0
WORKERS_S = 120.0
# Address of the scheduler that work goes to; empty where it stays on this machine.
SCHEDULER: ContextVar[str] = ContextVar("scheduler", default="")


# Idle workers inside `persistent_workers()`, which any work inside takes from and returns to.
_AT_REST: ContextVar[list[Worker] | None] = ContextVar("workers at rest", default=None)


@contextmanager
def persistent_workers() -> Iterator[None]:
    """Keep idle workers for further work inside; they end with the outermost block."""
    if _AT_REST.get() is not None:
        yield
        return
    at_rest: list[Worker] = []
    token = _AT_REST.set(at_rest)
    try:
        yield
    finally:
        _AT_REST.reset(token)
        if at_rest:
            dismiss(at_rest)


def silent(done: int, total: int) -> None:
    """Ignore progress."""


def surviving(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> Iterator[tuple[int, Value | None]]:
    """Work as `Execution.unordered`, always in other processes; if a worker dies, its item yields None.

    For long work: each worker is a pool of its own.
    """
    progress(0, len(items))
    with closing(_outcomes(function, list(enumerate(items)), jobs)) as results:
        for n_done, (index, outcome) in enumerate(results, start=1):
            if outcome.died:
                _refuse_unguarded()
            yield index, None if outcome.died else outcome.result
            progress(n_done, len(items))


def _outcomes(
    function: Callable[[Item], Value], items: Sequence[tuple[int, Item]], jobs: int, at_home: bool = False
) -> Generator[tuple[int, Outcome], None, None]:
    """Yield outcomes from the cluster of `on_dask`, or from processes of this machine, as they finish."""
    address, new = SCHEDULER.get(), None
    if address:
        with client_of(address) as client:
            jobs, new = len(places_of(client)), partial(Remote, address)
    return outcomes(function, items, min(jobs, len(items)), at_home, new, _AT_REST.get())


@dataclass(frozen=True)
class Execution:
    """Execution settings: number of processes `jobs`, progress(done, total), and `checkpoint` for finished results.

    jobs: of a cluster all workers work; 0: none but this process.  checkpoint: from where an interrupted computation
    of the same arguments is resumed; a dict, or a mapping that outlives the process. Results do not depend on any of
    the three.
    """

    jobs: int = 1
    progress: Progress = silent
    checkpoint: MutableMapping[str, Any] = field(default_factory=dict)

    def __reduce__(self) -> "tuple[type[Execution], tuple[int]]":
        """Execution in another process: by that one alone."""
        return Execution, (0,)

    @property
    def quiet(self) -> "Execution":
        """Execution without progress: of short work within a stage."""
        return replace(self, progress=silent)

    def is_shared(self, count: int) -> bool:
        """True if others than this process work at so many items."""
        return self.jobs > 0 and (min(self.jobs, count) > 1 or bool(SCHEDULER.get()))

    def ordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """Return [function(item) for item in items]."""
        return [value for _, value in sorted(self.unordered(function, items))]

    def unordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[tuple[int, Value]]:
        """Yield (index, function(item)) as they finish; in this process for one job or one item.

        function and items must pickle; the function goes to each worker once. The item of a worker that dies is done
        again. On KeyboardInterrupt the workers are ended at once; yielded results remain.
        Raises ElastidError where workers die again and again.
        """
        self.progress(0, len(items))
        if not self.is_shared(len(items)):
            for index, item in enumerate(items):
                yield index, function(item)
                self.progress(index + 1, len(items))
            return
        with closing(_by_workers(function, items, self.jobs)) as results:
            for n_done, (index, outcome) in enumerate(results, start=1):
                yield index, outcome.result
                self.progress(n_done, len(items))

    def at_home(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[Value]:
        """Yield function(item) of each item in turn, computed by the worker that has the item from earlier work.

        Neighbours have the same one. The first error in turn is raised, once all others have ended.
        """
        if not self.is_shared(len(items)):
            yield from map(function, items)
            return
        waiting: dict[int, Outcome] = {}
        index = 0
        with closing(_by_workers(function, items, self.jobs, at_home=True)) as results:
            for finished, outcome in results:
                waiting[finished] = outcome
                while index in waiting and waiting[index].error is None:
                    yield waiting.pop(index).value
                    index += 1
        if waiting:
            yield waiting[index].result

    def resumed(self, function: Callable[[Item], Value], items: Sequence[Item], names: Sequence[str]) -> list[Value]:
        """Return `ordered`, with values that the checkpoint has under their names; adds new values to it."""
        results = {index: self.checkpoint[name] for index, name in enumerate(names) if name in self.checkpoint}
        todo, n_done = [index for index in range(len(items)) if index not in results], len(results)

        def with_known(done: int, total: int) -> None:
            self.progress(done + n_done, total + n_done)

        for place, value in replace(self, progress=with_known).unordered(function, [items[index] for index in todo]):
            results[todo[place]] = self.checkpoint[names[todo[place]]] = value
        return [results[index] for index in range(len(items))]


HERE = Execution(0)

# Workers that may die in one work; half as many go on each time, since most die for lack of memory.
MOST_DEATHS = 4


def _by_workers(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, at_home: bool = False
) -> Generator[tuple[int, Outcome], None, None]:
    """Yield outcomes from workers; if a worker dies, half as many repeat its item."""
    remaining, deaths = dict(enumerate(items)), 0
    while remaining:
        with closing(_outcomes(function, list(remaining.items()), max(1, jobs >> deaths), at_home)) as results:
            for index, outcome in results:
                if outcome.died:
                    deaths += 1
                    break
                del remaining[index]
                yield index, outcome
        if remaining:
            _refuse_unguarded()
        if deaths == MOST_DEATHS:
            raise ElastidError(
                "workers/died",
                f"workers died {deaths} times, perhaps for lack of memory; try again with fewer --jobs, or give the "
                "cluster more",
            )


def _refuse_unguarded() -> None:
    """Raise ElastidError if the script that runs would begin again in every worker."""
    file = getattr(sys.modules["__main__"], "__file__", None)
    with suppress(OSError, UnicodeDecodeError):
        if file is not None and "__main__" not in Path(file).read_text(encoding="utf-8"):
            raise ElastidError(
                "workers/died",
                "worker processes import the script again. Protect its main part by `if __name__ == '__main__':`, or "
                "use jobs=1",
            )


@contextmanager
def on_dask(address: str) -> Iterator[None]:
    """Send work inside to the Dask scheduler at `address`; to processes for an empty address.

    Raises ElastidError where Dask is not installed or does not answer there.
    """
    if address:
        with client_of(address):  # now, not after hours of work
            pass
    token = SCHEDULER.set(address)
    try:
        yield
    finally:
        SCHEDULER.reset(token)


@contextmanager
def client_of(address: str) -> Iterator[Any]:
    """Connect to a Dask cluster; ElastidError without an answer of its scheduler or without a worker."""
    dask, failure = installed("distributed", "dask"), ""
    try:
        client = dask.Client(address, timeout=ANSWER_S, set_as_default=False)
    except Exception as error:  # of a scheme, too, for which a package is missing
        failure = f"no Dask scheduler answers at {address} (one prints its address: tcp://10.0.0.7:8786): {error}"
    if failure:
        # Now: collected amid the start of another, a client that failed waits for itself (distributed, Client.__del__).
        gc.collect()
        raise ElastidError("workers/cluster", failure)
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
        yield client
    except TimeoutError as error:
        raise ElastidError("workers/cluster", f"the cluster at {address} has no worker; start one") from error
    finally:
        client.close()


def places_of(client: Any) -> list[str]:
    """Return the address of the worker of each thread."""
    return [place for place, threads in sorted(client.nthreads().items()) for _ in range(threads)]


class Remote(Thread):
    """The process of a `Worker` on a cluster: messages of a pipe become tasks there, their values its answers."""

    pid = 0

    def __init__(self, address: str, pipe: Connection, index: int) -> None:
        super().__init__(daemon=True)
        self._stack, self._pipe = ExitStack(), pipe
        self._task: Any = None
        self._client = self._stack.enter_context(client_of(address))
        places = places_of(self._client)
        self._name, self._at = uuid4().hex, places[index % len(places)]

    def run(self) -> None:
        """Pass messages on until the pipe or the worker ends."""
        from distributed import CancelledError, KilledWorker

        with self._stack, closing(self._pipe), suppress(OSError, CancelledError, KilledWorker, LostError):
            with suppress(EOFError):
                while True:
                    message = self._client.scatter(self._pipe.recv_bytes(), hash=False, workers=[self._at])
                    try:
                        answer = self._call_remote(_answer, message)
                    except ImportError as error:  # its workers have other libraries
                        answer = End(keeps=False).packed(Outcome(error=error))
                    if answer is not None:
                        self._pipe.send_bytes(answer)
            self._call_remote(_forget)

    def _call_remote(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Ask the worker for a value; LostError if it is gone, for which the scheduler would wait for ever."""
        self._task = self._client.submit(function, self._name, *arguments, pure=False, workers=[self._at])
        while True:
            try:
                return self._task.result(ANSWER_S)
            except TimeoutError:
                if self._at not in self._client.nthreads():
                    raise LostError from None

    def terminate(self) -> None:
        """End at once; a task that runs already ends by itself."""
        with suppress(Exception):  # of Dask, where it has ended by itself
            if self._task is not None:
                self._task.cancel()


# Values at the workers of a process on a cluster, by their names.
_FUNCTIONS = dict[str, WorkerState]()


def _answer(name: str, message: bytes) -> bytes | None:
    """Answer as the worker of a name; LostError if it was another process."""
    answer = _FUNCTIONS.setdefault(name, WorkerState()).answer(message)
    return None if answer is None else bytes(answer)


def _forget(name: str) -> None:
    _FUNCTIONS.pop(name, None)
