"""Workers of a Dask cluster, which must see the same files: asked by the messages of `base.workers`, in tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from contextvars import ContextVar
from importlib.util import find_spec
from multiprocessing.connection import Connection
from threading import Thread
from typing import Any
from uuid import uuid4

from elastid.base.errors import ElastidError
from elastid.base.kept import End, LostError
from elastid.base.workers import Outcome, Served

# Seconds for a Dask scheduler to answer, and to look whether a worker is there; for the first one to start again.
ANSWER_S = 10.0
WORKERS_S = 120.0
# Address of the scheduler that work goes to; empty where it stays on this machine.
SCHEDULER: ContextVar[str] = ContextVar("scheduler", default="")


@contextmanager
def on_dask(address: str) -> Iterator[None]:
    """Inside, work goes to the Dask scheduler at `address` instead of processes; an empty address: to processes.

    Raises ElastidError where Dask is not installed or does not answer there.
    """
    if address and find_spec("distributed") is None:
        raise ElastidError(
            "install/missing-package",
            "Dask is not installed; `uv sync --extra dask` does it, or leave --dask out",
        )
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
    """A Dask cluster; ElastidError without certificates, where no scheduler answers, and where it gets no worker."""
    from distributed import Client
    from distributed.security import Security

    # Of an encrypted connection; without, there would be a traceback when the process ends, too.
    is_encrypted = address.startswith(("tls://", "wss://"))
    if is_encrypted and not Security().get_connection_args("client").get("ssl_context"):
        raise ElastidError(
            "workers/cluster",
            f"the Dask scheduler at {address} needs certificates, and none are configured; name them in the "
            "configuration of Dask (distributed.comm.tls), or give the address of a tcp scheduler",
        )
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except Exception as error:  # of a scheme, too, for which a package is missing
        text = f"no Dask scheduler answers at {address} (one prints its address: tcp://10.0.0.7:8786): {error}"
        raise ElastidError("workers/cluster", text) from error
    try:
        client.wait_for_workers(1, timeout=WORKERS_S)
        yield client
    except TimeoutError as error:
        raise ElastidError("workers/cluster", f"the cluster at {address} has no worker; start one") from error
    finally:
        client.close()


def places_of(client: Any) -> list[str]:
    """The address of the worker of each thread."""
    return [place for place, threads in sorted(client.nthreads().items()) for _ in range(threads)]


class Remote(Thread):
    """The process of a `Worker` on a cluster: messages of a pipe become tasks there, their values its answers."""

    pid = 0

    def __init__(self, address: str, pipe: Connection, place: int) -> None:
        super().__init__(daemon=True)
        self._stack, self._pipe = ExitStack(), pipe
        self._task: Any = None
        self._client = self._stack.enter_context(client_of(address))
        places = places_of(self._client)
        self._name, self._at = uuid4().hex, places[place % len(places)]

    def run(self) -> None:
        """Pass messages on until the pipe or the worker ends."""
        from distributed import CancelledError, KilledWorker

        with self._stack, closing(self._pipe), suppress(OSError, CancelledError, KilledWorker, LostError):
            with suppress(EOFError):
                while True:
                    message = self._client.scatter(self._pipe.recv_bytes(), hash=False, workers=[self._at])
                    try:
                        answer = self._asked(_answer, message)
                    except ImportError as error:  # its workers have other libraries
                        answer = End(keeps=False).packed(Outcome(error=error))
                    if answer is not None:
                        self._pipe.send_bytes(answer)
            self._asked(_forget)

    def _asked(self, function: Callable[..., Any], *given: Any) -> Any:
        """The value there; LostError where the worker is gone, for which the scheduler would wait for ever."""
        self._task = self._client.submit(function, self._name, *given, pure=False, workers=[self._at])
        while True:
            try:
                return self._task.result(ANSWER_S)
            except TimeoutError:
                if self._at not in self._client.nthreads():
                    raise LostError from None

    def terminate(self) -> None:
        """End at once; a task that runs already ends by itself."""
        with suppress(RuntimeError):  # where it has ended by itself
            if self._task is not None:
                self._task.cancel()


# What the workers of a process on a cluster have, by their names.
_SERVED = dict[str, Served]()


def _answer(name: str, message: bytes) -> bytes | None:
    """Answer of the worker of a name; LostError where it was another process."""
    answer = _SERVED.setdefault(name, Served()).answer(message)
    return None if answer is None else bytes(answer)


def _forget(name: str) -> None:
    _SERVED.pop(name, None)
