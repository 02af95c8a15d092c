"""Items that stay at workers, each at one of them, and are asked again and again.

`Execution` takes a function to every worker, with all that it holds. Where the data are most of the bytes, each part of
them is better sent to one worker, once: a process of this machine, or a worker of the Dask cluster of `on_dask`. A
worker that dies is replaced, and its successor is given the items as they are now.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from itertools import pairwise
from typing import Any
from weakref import finalize

from elastid.base.errors import ElastidError
from elastid.base.execution import MOST_DEATHS, SCHEDULER, WORKERS_S, Execution, client_of, outcome_of
from elastid.base.workers import Outcome, Worker, answers, end, new_worker

Function = Callable[[Any], Any]


class Placed:
    """Items at workers as long as something holds this, which goes to another process as None."""

    def __init__(self, items: Sequence[Any], execution: Execution) -> None:
        """Items go to their workers one by one, neighbours to the same one."""
        self._items, address = list(items), SCHEDULER.get()
        self._home: _Processes | _Cluster = _Cluster(address) if address else _Processes(execution.jobs)
        self._close = finalize(self, self._home.close)
        count = min(self._home.count, len(items))
        self._shares = [slice(*ends) for ends in pairwise(len(items) * i // count for i in range(count + 1))]
        for worker, share in enumerate(self._shares):
            self._home.place(worker, self._items[share])

    def __reduce__(self) -> tuple[Callable[[], None], tuple[()]]:
        return _nothing, ()

    def ask(self, function: Function) -> list[Any]:
        """function(item) of each, in order; its error as it is."""
        answered = self._asked(dict.fromkeys(range(len(self._shares)), function), self._home.ask)
        return [value for worker in range(len(self._shares)) for value in answered[worker]]

    def change(self, items: Sequence[Any], functions: Sequence[Function]) -> None:
        """Items are replaced by what a function makes of them: fewer bytes."""
        self._items = list(items)
        self._asked({worker: functions[share] for worker, share in enumerate(self._shares)}, self._home.change)

    def _asked(self, given: dict[int, Any], asked: Callable[[Mapping[int, Any]], dict[int, Outcome]]) -> dict[int, Any]:
        left, known = given, dict[int, Outcome]()
        try:
            for _ in range(MOST_DEATHS):
                known |= asked(left)
                left = {worker: what for worker, what in left.items() if known[worker].died}
                for worker in left:
                    self._home.place(worker, self._items[self._shares[worker]])
                if not left or asked == self._home.change:  # a successor has the new items
                    return {worker: outcome.result for worker, outcome in known.items()}
        except KeyboardInterrupt:  # answers may be on their way
            self._close()
            raise
        self._close()
        raise ElastidError(
            "workers/died", f"workers died {MOST_DEATHS} times, perhaps for lack of memory; give them more"
        )


def _nothing() -> None:
    return None


class _Share:
    """The items in a worker process: what it is asked, it is asked with these."""

    def __init__(self) -> None:
        self.items: list[Any] = []

    def __call__(self, asked: Callable[[list[Any]], Any]) -> Any:
        return asked(self.items)


def _add(item: Any, items: list[Any]) -> None:
    items.append(item)


def _each(function: Function, items: list[Any]) -> list[Any]:
    return [function(item) for item in items]


def _replace(functions: Sequence[Function], items: list[Any]) -> None:
    items[:] = [function(item) for function, item in zip(functions, items, strict=True)]


class _Processes:
    """Workers that are processes of this machine, which end with it."""

    def __init__(self, count: int) -> None:
        self.count, self._workers = count, dict[int, Worker]()

    def place(self, number: int, items: Sequence[Any]) -> None:
        if number in self._workers:
            end(self._workers.pop(number))
        worker = self._workers[number] = new_worker()
        share: bytes | None = pickle.dumps(_Share())
        for item in items:
            answers({0: (worker, pickle.dumps((share, partial(_add, item))))})
            share = None

    def ask(self, functions: Mapping[int, Function]) -> dict[int, Outcome]:
        return self._answers({number: partial(_each, function) for number, function in functions.items()})

    def change(self, functions: Mapping[int, Sequence[Function]]) -> dict[int, Outcome]:
        return self._answers({number: partial(_replace, each) for number, each in functions.items()})

    def _answers(self, asked: Mapping[int, Any]) -> dict[int, Outcome]:
        return answers({i: (self._workers[i], pickle.dumps((None, message))) for i, message in asked.items()})

    def close(self) -> None:
        for worker in self._workers.values():
            end(worker)


class _Cluster:
    """Workers of a Dask cluster; a task for each worker and question."""

    def __init__(self, address: str) -> None:
        self._stack, self._at = ExitStack(), dict[int, str]()
        self._items: dict[int, list[Any]] = {}
        self._client = self._stack.enter_context(client_of(address))
        self.count = len(self._client.nthreads())

    def place(self, number: int, items: Sequence[Any]) -> None:
        self._client.wait_for_workers(1, timeout=WORKERS_S)
        places = sorted(self._client.nthreads())
        self._at[number] = places[number % len(places)]
        self._items[number] = [self._sent(number, item) for item in items]

    def _sent(self, number: int, item: Any) -> Any:
        return self._client.scatter(item, hash=False, workers=[self._at[number]], timeout=WORKERS_S)

    def _submitted(self, number: int, function: Callable[..., Any], *given: Any) -> Any:
        where = {"workers": [self._at[number]], "allow_other_workers": True}
        return self._client.submit(function, *given, pure=False, **where)

    def ask(self, functions: Mapping[int, Function]) -> dict[int, Outcome]:
        futures = {i: self._submitted(i, _each, function, self._items[i]) for i, function in functions.items()}
        return {i: outcome_of(future.result) for i, future in futures.items()}

    def change(self, functions: Mapping[int, Sequence[Function]]) -> dict[int, Outcome]:
        for i, each in functions.items():
            pairs = zip(self._items[i], each, strict=True)
            self._items[i] = [self._submitted(i, _applied, item, self._sent(i, function)) for item, function in pairs]
        return {i: outcome_of(partial(_finished, self._items[i])) for i in functions}

    def close(self) -> None:
        self._stack.close()


def _applied(item: Any, function: Function) -> Any:
    return function(item)


def _finished(futures: Sequence[Any]) -> None:
    """When all have ended; the error of one that failed."""
    for future in futures:
        if (error := future.exception()) is not None:
            raise error
