"""Independent work in several processes: same results whatever the number of workers, and a clean stop on Ctrl-C.

Processes of this machine, or, inside `on_dask(address)`, the workers of a Dask cluster, which must see the same files.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterable, Iterator, MutableMapping, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from elastid.base.cluster import SCHEDULER, on_cluster, survived_on_cluster
from elastid.base.errors import ElastidError
from elastid.base.workers import has_died, outcomes

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

    @property
    def quiet(self) -> Execution:
        """The same without progress: of short work within a stage."""
        return replace(self, progress=silent)

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
    """By processes of this machine; what a worker that dies was at is done anew, by half as many."""
    # Pickled here, so that an error of pickling is reported as such.
    work, left, deaths = pickle.dumps(function), dict(enumerate(items)), 0
    while left:
        with closing(outcomes(work, list(left.items()), min(max(1, jobs >> deaths), len(left)))) as found:
            for index, future in found:
                if has_died(future):
                    deaths += 1
                    break
                value = future.result()
                del left[index]
                yield index, value
        if left and _main_is_unguarded():
            raise ElastidError(_UNGUARDED)
        if deaths == _MOST_DEATHS:
            raise ElastidError(
                f"worker processes died {deaths} times, perhaps for lack of memory; try again with fewer --jobs"
            )


def _survived(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int
) -> Iterator[tuple[int, Value | None]]:
    """By processes of this machine; an item at which a worker died is None."""
    with closing(outcomes(pickle.dumps(function), enumerate(items), min(jobs, len(items)))) as found:
        for index, future in found:
            died = has_died(future)
            if died and _main_is_unguarded():
                raise ElastidError(_UNGUARDED)
            yield index, None if died else future.result()


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
