"""Dask cluster: the workers of its threads receive the messages of `base.messages` in tasks."""

import gc
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from contextvars import ContextVar
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any
from uuid import uuid4

from elastid.base.errors import ElastidError, require_package
from elastid.base.messages import LostError, PipeEnd
from elastid.base.workers import Outcome, WorkerState

ANSWER_S = 10.0  # time limit of an answer of the scheduler, and interval of the checks that a worker exists
WORKERS_S = 120.0  # time limit for the start of the first worker
# Address of the Dask scheduler; empty for work on this machine.
SCHEDULER: ContextVar[str] = ContextVar("scheduler", default="")


@contextmanager
def on_dask(address: str) -> Iterator[None]:
    """Send work inside to a Dask scheduler, or to processes for an empty address; ElastidError without an answer."""
    if address:
        with connect(address):  # a failure now, not after hours of work
            pass
    token = SCHEDULER.set(address)
    try:
        yield
    finally:
        SCHEDULER.reset(token)


@contextmanager
def connect(address: str) -> Iterator[Any]:
    """Yield a client of a Dask cluster; ElastidError if the scheduler does not answer or has no worker."""
    dask, failure = require_package("distributed", "dask"), ""
    try:
        client = dask.Client(address, timeout=ANSWER_S, set_as_default=False)
    except Exception as error:  # ImportError, too, if the package for a scheme is missing
        failure = f"no Dask scheduler answers at {address} (one prints its address: tcp://10.0.0.7:8786): {error}"
    if failure:
        # Collected later, during the start of another client, this one would wait for itself (Client.__del__).
        gc.collect()
        raise ElastidError("workers/cluster", failure)
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
        yield client
    except TimeoutError as error:
        raise ElastidError("workers/cluster", f"the cluster at {address} has no worker; start one") from error
    finally:
        client.close()


def thread_addresses(client: Any) -> list[str]:
    """Return the address of the worker of each thread."""
    return [address for address, threads in sorted(client.nthreads().items()) for _ in range(threads)]


class DaskProcess(Thread):
    """Process of a `Worker` on a cluster: each message of its pipe becomes a task, whose result is the answer."""

    pid = 0

    def __init__(self, address: str, pipe: Connection, index: int) -> None:
        super().__init__(daemon=True)
        self._stack, self._pipe = ExitStack(), pipe
        self._task: Any = None
        self._client = self._stack.enter_context(connect(address))
        addresses = thread_addresses(self._client)
        self._name, self._address = uuid4().hex, addresses[index % len(addresses)]

    def run(self) -> None:
        """Forward messages until the pipe or the worker ends."""
        from distributed import CancelledError, KilledWorker

        with self._stack, closing(self._pipe), suppress(OSError, CancelledError, KilledWorker, LostError):
            with suppress(EOFError):
                while True:
                    message = self._client.scatter(self._pipe.recv_bytes(), hash=False, workers=[self._address])
                    try:
                        answer = self._call_remote(_answer, message)
                    except ImportError as error:  # a library is missing on the cluster
                        answer = PipeEnd(keeps=False).pack(Outcome(error=error))
                    if answer is not None:
                        self._pipe.send_bytes(answer)
            self._call_remote(_forget)

    def _call_remote(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function at the worker; LostError if the worker is gone (the scheduler would wait for ever)."""
        self._task = self._client.submit(function, self._name, *arguments, pure=False, workers=[self._address])
        while True:
            try:
                return self._task.result(ANSWER_S)
            except TimeoutError:
                if self._address not in self._client.nthreads():
                    raise LostError from None

    def terminate(self) -> None:
        """Cancel the task; a task that runs already ends by itself."""
        with suppress(Exception):  # Dask raises one for a task that has ended
            if self._task is not None:
                self._task.cancel()


# States of the workers in a process of the cluster, by the names of their `DaskProcess`.
_STATES = dict[str, WorkerState]()


def _answer(name: str, message: bytes) -> bytes | None:
    """Answer as the worker of a name; LostError if the worker was a process that has died."""
    answer = _STATES.setdefault(name, WorkerState()).answer(message)
    return None if answer is None else bytes(answer)


def _forget(name: str) -> None:
    _STATES.pop(name, None)
