"""Independent computations in processes or on a Dask cluster: the result does not depend on the number of workers.

Work runs in processes of this machine or, inside `dask_cluster.on_dask(address)`, at the workers of a Dask cluster,
which must see the same files. On Ctrl-C all workers end.
"""

import sys
from collections.abc import Callable, Generator, Iterator, MutableMapping, Sequence
from contextlib import closing, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from elastid.base.dask_cluster import SCHEDULER, DaskProcess, connect, thread_addresses
from elastid.base.errors import ElastidError
from elastid.base.workers import Outcome, Worker, dismiss, outcomes

Item = TypeVar("Item")
Value = TypeVar("Value")

Progress: TypeAlias = Callable[[int, int], None]

# Idle workers inside `persistent_workers()`.
_IDLE: ContextVar[list[Worker] | None] = ContextVar("idle workers", default=None)


@contextmanager
def persistent_workers() -> Iterator[None]:
    """Keep idle workers for further work inside; they end with the outermost block."""
    if _IDLE.get() is not None:
        yield
        return
    idle: list[Worker] = []
    token = _IDLE.set(idle)
    try:
        yield
    finally:
        _IDLE.reset(token)
        dismiss(idle)


def no_progress(done: int, total: int) -> None:
    """Ignore progress."""


def map_isolated(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = no_progress
) -> Iterator[tuple[int, Value | None]]:
    """Yield (index, function(item)) as they finish, always in other processes; None for an item whose worker died."""
    progress(0, len(items))
    with closing(_outcomes(function, list(enumerate(items)), jobs)) as results:
        for n_done, (index, outcome) in enumerate(results, start=1):
            if outcome.died:
                _refuse_unguarded()
            yield index, None if outcome.died else outcome.result
            progress(n_done, len(items))


def _outcomes(
    function: Callable[[Item], Value], items: Sequence[tuple[int, Item]], jobs: int, has_affinity: bool = False
) -> Generator[tuple[int, Outcome], None, None]:
    """Yield outcomes from the cluster of `on_dask`, or from processes of this machine, as they finish."""
    address, new_process = SCHEDULER.get(), None
    if address:
        with connect(address) as client:
            jobs, new_process = len(thread_addresses(client)), partial(DaskProcess, address)
    return outcomes(function, items, min(jobs, len(items)), has_affinity, new_process, _IDLE.get())


@dataclass(frozen=True)
class Execution:
    """Execution settings; results depend on none of them.

    jobs: number of processes, 0 for this process alone; a cluster uses all its workers.  progress(done, total): called
    after each item.  checkpoint: finished results by name, from which `resumed` continues an interrupted computation;
    a dict, or a mapping that outlives the process.
    """

    jobs: int = 1
    progress: Progress = no_progress
    checkpoint: MutableMapping[str, Any] = field(default_factory=dict)

    def __reduce__(self) -> "tuple[type[Execution], tuple[int]]":
        """Pickle as an execution of the other process alone: workers do not start workers."""
        return Execution, (0,)

    @property
    def quiet(self) -> "Execution":
        """Execution without progress, for short computations within a stage."""
        return replace(self, progress=no_progress)

    def is_shared(self, count: int) -> bool:
        """Return True if `count` items are computed by other processes."""
        return self.jobs > 0 and (min(self.jobs, count) > 1 or bool(SCHEDULER.get()))

    def ordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """Return [function(item) for item in items]."""
        return [value for _, value in sorted(self.unordered(function, items))]

    def unordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[tuple[int, Value]]:
        """Yield (index, function(item)) as they finish; in this process for one job or one item.

        function and items must pickle; the function is sent to each worker once. If a worker dies, its item is
        computed again. On KeyboardInterrupt the workers are terminated; yielded results remain.
        Raises ElastidError if `MAX_DEATHS` workers die.
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

    def with_affinity(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[Value]:
        """Yield function(item) in the order of the items; each is computed by the worker that received it before.

        Neighbouring items go to one worker. The first error in this order is raised after all items have ended.
        """
        if not self.is_shared(len(items)):
            yield from map(function, items)
            return
        waiting = {}
        index = 0
        with closing(_by_workers(function, items, self.jobs, has_affinity=True)) as results:
            for index_done, outcome in results:
                waiting[index_done] = outcome
                while index in waiting and waiting[index].error is None:
                    yield waiting.pop(index).value
                    index += 1
        if waiting:
            yield waiting[index].result

    def resumed(self, function: Callable[[Item], Value], items: Sequence[Item], names: Sequence[str]) -> list[Value]:
        """Return `ordered` without computing values that the checkpoint has by name; add new values to it."""
        results = {name: self.checkpoint[name] for name in names if name in self.checkpoint}
        todo, n_done = [pair for pair in zip(names, items, strict=True) if pair[0] not in results], len(results)

        def progress(done: int, total: int) -> None:
            self.progress(done + n_done, total + n_done)

        for i, value in replace(self, progress=progress).unordered(function, [item for _, item in todo]):
            name, _ = todo[i]
            results[name] = self.checkpoint[name] = value
        return [results[name] for name in names]


SERIAL = Execution(0)  # in this process alone

MAX_DEATHS = 4  # of workers in one computation; each halves the number of workers, since most die for lack of memory


def _by_workers(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, has_affinity: bool = False
) -> Generator[tuple[int, Outcome], None, None]:
    """Yield outcomes from workers; if a worker dies, half as many repeat its item."""
    remaining, deaths = dict(enumerate(items)), 0
    while remaining:
        with closing(_outcomes(function, list(remaining.items()), max(1, jobs >> deaths), has_affinity)) as results:
            for index, outcome in results:
                if outcome.died:
                    deaths += 1
                    break
                del remaining[index]
                yield index, outcome
        if remaining:
            _refuse_unguarded()
        if deaths == MAX_DEATHS:
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
