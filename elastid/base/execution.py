"""Independent work in processes or on a Dask cluster: the same results whatever their number, a clean end on Ctrl-C.

Processes of this machine, or, inside `on_dask(address)`, the workers of a Dask cluster, which must see the same files.
"""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, MutableMapping, Sequence
from concurrent.futures import CancelledError, as_completed
from contextlib import closing, contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeAlias, TypeVar
from urllib.parse import urlsplit

from elastid.base.errors import ElastidError, StudyError
from elastid.base.workers import Outcome, outcomes

Item = TypeVar("Item")
Value = TypeVar("Value")

# Seconds for a Dask scheduler to answer, and for the first worker to start, or to start again.
ANSWER_S = 10.0
WORKERS_S = 120.0
# Schemes of an address over a network; those with True need certificates from the configuration of Dask.
SCHEMES = {"tcp": False, "tls": True, "ws": False, "wss": True}
# Address of the scheduler that work goes to; empty where it stays on this machine.
SCHEDULER: ContextVar[str] = ContextVar("scheduler", default="")


@contextmanager
def on_dask(address: str) -> Iterator[None]:
    """Inside, work goes to the Dask scheduler at `address` instead of processes; an empty address: to processes.

    Raises ElastidError where Dask is not installed, StudyError for a text that is no address.
    """
    if address and find_spec("distributed") is None:
        raise ElastidError(
            "install/missing-package",
            "Dask is not installed; `uv sync --extra dask` does it, or leave --dask out",
        )
    if address and not _is_address(address):
        raise StudyError(
            "options/invalid",
            "not the address of a Dask scheduler; give scheme, host and port as the scheduler "
            "prints them, such as tcp://10.0.0.7:8786",
            f"--dask {address}",
        )
    token = SCHEDULER.set(address)
    try:
        yield
    finally:
        SCHEDULER.reset(token)


def _is_address(address: str) -> bool:
    """True for [scheme://]host:port, and for inproc://host/process/number, a cluster within this process."""
    scheme, separator, place = address.rpartition("://")
    if scheme == "inproc":
        return len(place.split("/")) == 3
    try:
        parts = urlsplit(address if separator else f"tcp://{address}")
        return parts.scheme in SCHEMES and bool(parts.hostname and parts.port) and not any(map(str.isspace, address))
    except ValueError:  # a port that is no number, or an unclosed bracket
        return False


@contextmanager
def client_of(address: str) -> Iterator[Any]:
    """A Dask cluster; ElastidError without certificates, where no scheduler answers, and where it gets no worker."""
    from distributed import Client
    from distributed.security import Security

    # Of an encrypted connection.
    if SCHEMES.get(address.partition("://")[0]) and not Security().get_connection_args("client").get("ssl_context"):
        raise ElastidError(
            "workers/cluster",
            f"the Dask scheduler at {address} needs certificates, and none are configured; name them in the "
            "configuration of Dask (distributed.comm.tls), or give the address of a tcp scheduler",
        )
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except Exception as error:  # of a scheme, too, for which a package is missing
        raise ElastidError("workers/cluster", f"no Dask scheduler answers at {address}: {error}") from error
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
        yield client
    except TimeoutError as error:
        raise ElastidError("workers/cluster", f"the cluster at {address} has no worker; start one") from error
    finally:
        client.close()


def outcome_of(result: Callable[[], Any]) -> Outcome:
    """The end of a task of a cluster: its value, its error, or the death of its workers."""
    from distributed import KilledWorker

    try:
        return Outcome(result())
    except (CancelledError, KilledWorker):
        return Outcome(died=True)
    except Exception as error:
        return Outcome(error=error)


def _applied(function: Callable[[Item], Value], item: Item) -> Value:
    return function(item)


def _on_cluster(
    address: str, function: Callable[[Item], Value], items: Mapping[int, Item], is_shared: bool
) -> Generator[tuple[int, Outcome], None, None]:
    """Outcomes from a cluster; is_shared: the function is sent to each worker once, and lost with the last of them."""
    from distributed.comm import CommClosedError

    with client_of(address) as client:
        try:
            work = client.scatter(function, broadcast=True, hash=False, timeout=WORKERS_S) if is_shared else function
        except CommClosedError:  # of a worker that dies meanwhile
            yield next(iter(items)), Outcome(died=True)
            return
        submit = client.get_executor(pure=False).submit
        futures = {submit(_applied, work, item): index for index, item in items.items()}
        for future in as_completed(futures):
            yield futures[future], outcome_of(future.result)


def _outcomes(
    function: Callable[[Item], Value], items: Mapping[int, Item], jobs: int, is_shared: bool = True
) -> Generator[tuple[int, Outcome], None, None]:
    """Outcomes from the cluster, or from processes of this machine, as they finish."""
    if address := SCHEDULER.get():
        return _on_cluster(address, function, items, is_shared)
    # Pickled here, so that an error of pickling is reported as such.
    return outcomes(pickle.dumps(function), list(items.items()), min(jobs, len(items)))


Progress: TypeAlias = Callable[[int, int], None]


def silent(done: int, total: int) -> None:
    """Progress that is not shown."""


def surviving(
    function: Callable[[Item], Value], items: Sequence[Item], jobs: int, progress: Progress = silent
) -> Iterator[tuple[int, Value | None]]:
    """`Execution.unordered`, always in other processes: a worker that dies costs the item that it was at: None.

    For long work: each worker is a pool of its own. On a cluster the scheduler has then tried the item several times.
    """

    def survived() -> Iterator[tuple[int, Value | None]]:
        with closing(_outcomes(function, dict(enumerate(items)), jobs, is_shared=False)) as results:
            for index, outcome in results:
                if outcome.died and _main_is_unguarded():
                    raise ElastidError("workers/died", _UNGUARDED)
                yield index, None if outcome.died else outcome.result

    return _counted(survived(), len(items), progress)


def _counted(results: Iterable[Value], total: int, progress: Progress) -> Iterator[Value]:
    progress(0, total)
    for done, result in enumerate(results, start=1):
        yield result
        progress(done, total)


@dataclass(frozen=True)
class Execution:
    """How work is run: by `jobs` processes, reporting progress(done, total), keeping what is finished in `checkpoint`.

    checkpoint: from where an interrupted computation of the same arguments is resumed; a dict, or a mapping that
    outlives the process. Results do not depend on any of the three.
    """

    jobs: int = 1
    progress: Progress = silent
    checkpoint: MutableMapping[str, Any] = field(default_factory=dict)

    @property
    def quiet(self) -> Execution:
        """Execution without progress: of short work within a stage."""
        return replace(self, progress=silent)

    @property
    def is_shared(self) -> bool:
        """True if others than this process work."""
        return self.jobs > 1 or bool(SCHEDULER.get())

    def ordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> list[Value]:
        """[function(item) for item in items]."""
        return list(self.in_turn(function, items))

    def in_turn(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[Value]:
        """function(item) of each item in turn, as soon as it and all before it are known."""
        known: dict[int, Value] = {}
        index = 0
        for finished, value in self.unordered(function, items):
            known[finished] = value
            while index in known:
                yield known.pop(index)
                index += 1

    def unordered(self, function: Callable[[Item], Value], items: Sequence[Item]) -> Iterator[tuple[int, Value]]:
        """(index, function(item)) as they finish; in this process for one job or one item.

        function and items must pickle; the function goes to each worker once. The item of a worker that dies is done
        again. On KeyboardInterrupt the workers are ended at once and what was yielded is kept.
        Raises ElastidError where workers die again and again.
        """
        if SCHEDULER.get() or min(self.jobs, len(items)) > 1:
            results = _by_workers(function, items, self.jobs)
        else:
            results = ((index, function(item)) for index, item in enumerate(items))
        return _counted(results, len(items), self.progress)

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


# Workers that may die in one work; half as many go on each time, since most die for lack of memory.
MOST_DEATHS = 4


def _by_workers(function: Callable[[Item], Value], items: Sequence[Item], jobs: int) -> Iterator[tuple[int, Value]]:
    """Values from workers; the item of a worker that dies is done again, by half as many."""
    left, deaths = dict(enumerate(items)), 0
    while left:
        with closing(_outcomes(function, left, max(1, jobs >> deaths))) as results:
            for index, outcome in results:
                if outcome.died:
                    deaths += 1
                    break
                value = outcome.result
                del left[index]
                yield index, value
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
