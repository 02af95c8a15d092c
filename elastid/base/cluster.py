"""Work on the workers of a Dask cluster, which must see the same files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, as_completed
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from importlib.util import find_spec
from typing import Any, TypeVar
from urllib.parse import urlsplit

from elastid.base.errors import ElastidError, StudyError

Item = TypeVar("Item")
Value = TypeVar("Value")

# Seconds for a Dask scheduler to answer, and for the first worker to start, or to start again.
ANSWER_S = 10.0
WORKERS_S = 120.0
# Schemes of an address over a network; those with True need certificates from the configuration of Dask.
SCHEMES = {"tcp": False, "tls": True, "ws": False, "wss": True, "ucx": False}
# Address of the scheduler that work goes to; empty where it stays on this machine.
SCHEDULER: ContextVar[str] = ContextVar("scheduler", default="")


@contextmanager
def on_dask(address: str) -> Iterator[None]:
    """Inside, work goes to the Dask scheduler at `address` instead of processes; an empty address changes nothing.

    Raises ElastidError where Dask is not installed, StudyError for a text that is no address.
    """
    if address and find_spec("distributed") is None:
        raise ElastidError("Dask is not installed; install elastid with the extra dask, or leave --dask out")
    if address and not _is_address(address):
        raise StudyError(
            f"--dask {address}: not the address of a Dask scheduler; give scheme, host and port as the scheduler "
            "prints them, such as tcp://10.0.0.7:8786"
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
def on_cluster(address: str, function: Callable[[Item], Value]) -> Iterator[Callable[[Item], Future[Value]]]:
    """What submits an item to the workers of a Dask cluster, each of which has the function.

    CancelledError where a worker dies while it is given the function, ElastidError where there is no worker.
    """
    from distributed.comm import CommClosedError

    with _client(address) as client:
        try:
            there = client.scatter(function, broadcast=True, hash=False, timeout=WORKERS_S)
        except CommClosedError as error:
            raise CancelledError from error
        except TimeoutError as error:
            raise ElastidError(f"the cluster at {address} has no worker; start one") from error
        yield partial(client.get_executor(pure=False).submit, _applied, there)


def survived_on_cluster(
    address: str, function: Callable[[Item], Value], items: Sequence[Item]
) -> Iterator[tuple[int, Value | None]]:
    """(index, function(item)), or (index, None) where workers died at an item again and again.

    The function goes with each item, so that no worker's death loses it.
    """
    from distributed import KilledWorker

    with _client(address) as client:
        submit = client.get_executor(pure=False).submit
        futures = {submit(function, item): index for index, item in enumerate(items)}
        for future in as_completed(futures):
            died = isinstance(future.exception(), KilledWorker)
            yield futures[future], None if died else future.result()


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A Dask cluster; ElastidError where no scheduler answers, or where one item kills all its workers."""
    from distributed import Client, KilledWorker

    _require_certificates(address)
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except OSError as error:
        raise ElastidError(f"no Dask scheduler answers at {address}: {error}") from error
    try:
        yield client
    except KilledWorker as error:
        raise ElastidError(
            f"workers of the cluster at {address} died at the same item, perhaps for lack of memory; give them more"
        ) from error
    finally:
        client.close()


def _require_certificates(address: str) -> None:
    """ElastidError where an encrypted connection is asked for and Dask has no certificates for it."""
    from distributed.security import Security

    if SCHEMES.get(address.partition("://")[0]) and not Security().get_connection_args("client").get("ssl_context"):
        raise ElastidError(
            f"the Dask scheduler at {address} needs certificates, and none are configured; name them in the "
            "configuration of Dask (distributed.comm.tls), or give the address of a tcp scheduler"
        )


def _applied(function: Callable[[Item], Value], item: Item) -> Value:
    return function(item)
