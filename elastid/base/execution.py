"""Independent work in processes or on a Dask cluster: the same results whatever their number, a clean end on Ctrl-C.

Processes of this machine, or, inside `on_dask(address)`, the workers of a Dask cluster, which must see the same files.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator, Iterator, MutableMapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from elastid.base.cluster import SCHEDULER, Remote, client_of, places_of
from elastid.base.errors import ElastidError
from elastid.base.workers import Outcome, outcomes

Item = TypeVar("Item")
Value = TypeVar("Value")

Progress: TypeAlias = Callable[[int, int], None]


def silent(done: int, total: int) -> None:
    """Progress that is not shown."""


def surviving(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> Iterator[tuple[int, Value | None]]:
    """`Execution.unordered`, always in other processes: a worker that dies costs the item that it was at: None.

    For long work: each worker is a pool of its own.
    """
    progress(0, len(items))
    with closing(_outcomes(function, list(enumerate(items)), jobs)) as results:
        for done, (index, outcome) in enumerate(results, start=1):
            if outcome.died and _main_is_unguarded():
                raise ElastidError("workers/died", _UNGUARDED)
            yield index, None if outcome.died else outcome.result
            progress(done, len(items))


def _outcomes(
    function: Callable[[Item], Value], items: Sequence[tuple[int, Item]], jobs: int, at_home: bool = False
) -> Generator[tuple[int, Outcome], None, None]:
    """Outcomes from the cluster of `on_dask`, or from processes of this machine, as they finish."""
    address, new = SCHEDULER.get(), None
    if address:
        with client_of(address) as client:
            jobs, new = len(places_of(client)), partial(Remote, address)
    return outcomes(function, items, min(jobs, len(items)), at_home, new)


@dataclass(frozen=True)
class Execution:
    """How work is run: by `jobs` processes, reporting progress(done, total), keeping what is finished in `checkpoint`.

    jobs: of a cluster all workers work; 0: none but this process.  checkpoint: from where an interrupted computation
    of the same arguments is resumed; a dict, or a mapping that outlives the process. Results do not depend on any of
    the three.
    """

    jobs: int = 1
    progress: Progress = silent
    checkpoint: MutableMapping[str, Any] = field(default_factory=dict)

    def __reduce__(self) -> tuple[type[Execution], tuple[int]]:
        """Execution in another process: by that one alone."""
        return Execution, (0,)

    @property
    def quiet(self) -> Execution:
        """Execution without progress: of short work within a stage."""
        return replace(self, progress=silent)

    def is_shared(self, count: int) -> bool:
        """True if others than this process work at so many items."""
        return self.jobs > 0 and (min(self.jobs, count) > 1 or bool(SCHEDULER.get()))

    def ordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """[function(item) for item in items]."""
        found = dict(self.unordered(function, items))
        return [found[index] for index in range(len(items))]

    def unordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[tuple[int, Value]]:
        """(index, function(item)) as they finish; in this process for one job or one item.

        function and items must pickle; the function goes to each worker once. The item of a worker that dies is done
        again. On KeyboardInterrupt the workers are ended at once and what was yielded is kept.
        Raises ElastidError where workers die again and again.
        """
        self.progress(0, len(items))
        with closing(self._outcomes(function, items)) as results:
            for done, (index, outcome) in enumerate(results, start=1):
                yield index, outcome.result
                self.progress(done, len(items))

    def at_home(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[Value]:
        """function(item) of each item in turn, by the worker that has the items of its place from earlier work.

        Neighbours have the same one. The first error in turn is raised, once all others have ended.
        """
        known: dict[int, Outcome] = {}
        index = 0
        with closing(self._outcomes(function, items, at_home=True)) as results:
            for finished, outcome in results:
                known[finished] = outcome
                while index in known and known[index].error is None:
                    yield known.pop(index).value
                    index += 1
        if known:
            yield known[index].result

    def _outcomes(
        self, function: Callable[[Item], Value], items: Sequence[Item], at_home: bool = False
    ) -> Generator[tuple[int, Outcome], None, None]:
        if self.is_shared(len(items)):
            return _by_workers(function, items, self.jobs, at_home)
        return ((index, Outcome(function(item))) for index, item in enumerate(items))

    def resumed(self, function: Callable[[Item], Value], items: Sequence[Item], names: Sequence[str]) -> list[Value]:
        """`ordered`, resumed: values in the checkpoint under the names are known, new ones are kept there."""
        found = {index: self.checkpoint[name] for index, name in enumerate(names) if name in self.checkpoint}
        todo, known = [index for index in range(len(items)) if index not in found], len(found)

        def with_known(done: int, total: int) -> None:
            self.progress(done + known, total + known)

        shown = replace(self, progress=with_known)
        for place, value in shown.unordered(function, [items[index] for index in todo]):
            found[todo[place]] = self.checkpoint[names[todo[place]]] = value
        return [found[index] for index in range(len(items))]


HERE = Execution(0)

# Workers that may die in one work; half as many go on each time, since most die for lack of memory.
MOST_DEATHS = 4


def _by_workers(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, at_home: bool = False
) -> Generator[tuple[int, Outcome], None, None]:
    """Outcomes from workers; the item of a worker that dies is done again, by half as many."""
    left, deaths = dict(enumerate(items)), 0
    while left:
        with closing(_outcomes(function, list(left.items()), max(1, jobs >> deaths), at_home)) as results:
            for index, outcome in results:
                if outcome.died:
                    deaths += 1
                    break
                del left[index]
                yield index, outcome
        if left and _main_is_unguarded():
            raise ElastidError("workers/died", _UNGUARDED)
        if deaths == MOST_DEATHS:
            raise ElastidError(
                "workers/died",
                f"workers died {deaths} times, perhaps for lack of memory; try again with fewer --jobs, or give the "
                "cluster more",
            )


_UNGUARDED = (
    "a script that works in several processes is read by each of them: put what it does under "
    "if __name__ == '__main__':, or take jobs=1"
)


def _main_is_unguarded() -> bool:
    """True if the script that runs would begin again in every worker."""
    file = getattr(sys.modules.get("__main__"), "__file__", None)
    try:
        return file is not None and "__main__" not in Path(file).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return False


def ordered(function: Callable[[Item], Value], items: Sequence[Item], jobs: int) -> list[Value]:
    """[function(item) for item in items], computed by several processes."""
    return Execution(jobs).ordered(function, items)
