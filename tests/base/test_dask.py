"""Work on the workers of a Dask cluster: the same results as in this process."""

import gc
import math
import os
import re
import time

import numpy as np
import pytest
from plants.marks import slow
from plants.refusals import refused

from elastid.base.dask_cluster import on_dask
from elastid.base.execution import Execution, persistent_workers

pytestmark = pytest.mark.slow  # clusters of several processes
distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def address():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        yield cluster.scheduler_address


@pytest.mark.filterwarnings("default")
def test_cluster_work_returns_ordered_values_and_errors(monkeypatch):
    """Also where a worker dies that the scheduler does not know of yet; without any worker there is a sentence.

    The worker is a thread of this process: what is sent and what comes back.
    """
    submit, calls = distributed.Client.submit, []

    def closed_once(*given, **options):
        calls.append(1)
        if len(calls) == 1:
            raise distributed.comm.CommClosedError("Stream is closed")
        return submit(*given, **options)

    monkeypatch.setattr(distributed.Client, "submit", closed_once)
    monkeypatch.setattr("elastid.base.dask_cluster.WORKERS_S", 0.5)
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
        ) as cluster,
        on_dask(cluster.scheduler_address),
    ):
        assert Execution(1).ordered(math.sqrt, [4.0, 1.0, 9.0]) == [2.0, 1.0, 3.0]
        assert len(calls) > 1
        with pytest.raises(ValueError, match=r"math domain|nonnegative"):
            Execution(1).ordered(math.sqrt, [1.0, -1.0])
        cluster.scale(0)
        while cluster.scheduler.workers:
            time.sleep(0.01)
        with refused("workers/cluster"):
            Execution(1).ordered(math.sqrt, [4.0, 1.0])


class DyingOnce:
    """Squares; the first worker that comes to 3 is killed there."""

    def __init__(self, folder):
        self.died = folder / "died"

    def __call__(self, item: int) -> int:
        if item == 3:
            try:
                self.died.touch(exist_ok=False)
            except FileExistsError:
                return item * item
            os._exit(9)
        return item * item


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_work_outlives_the_only_worker_of_a_cluster(tmp_path, monkeypatch):
    """And with it the function that the items share: its successor is given both."""
    monkeypatch.setattr("elastid.base.dask_cluster.ANSWER_S", 2.0)
    alone = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": 50}
    with distributed.LocalCluster(**alone) as cluster, on_dask(cluster.scheduler_address):
        assert Execution(1).ordered(DyingOnce(tmp_path), list(range(6))) == [0, 1, 4, 9, 16, 25]
    assert (tmp_path / "died").exists()


def process(item: int) -> int:
    return os.getpid()


@pytest.mark.filterwarnings("default")
def test_cluster_items_go_to_workers_that_have_them(address, tmp_path, monkeypatch):
    """Each at one of them; one that dies is followed by another."""
    monkeypatch.setattr("elastid.base.dask_cluster.ANSWER_S", 2.0)
    with on_dask(address), persistent_workers():
        there, large = Execution(), [np.zeros(n) for n in (200_000, 1000, 100)]
        for array in large:
            array.flags.writeable = False
        processes = list(there.with_affinity(process, large))
        assert processes[0] != processes[1] == processes[2]
        assert list(there.with_affinity(process, large)) == processes
        assert list(there.with_affinity(len, large)) == [200_000, 1000, 100]
        assert list(there.with_affinity(DyingOnce(tmp_path), [1, 3, 5])) == [1, 9, 25]
        assert (tmp_path / "died").exists()
        assert list(there.with_affinity(len, large)) == [200_000, 1000, 100]
        with pytest.raises(TypeError, match=r"string pattern|expected string"):
            list(there.with_affinity(re.compile("x").match, [1, 2]))


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", slow("x"), slow("host:notaport"), "foo://x:1", slow("tcp://[::1"), "tls://a:1"]
)
def test_address_without_scheduler_is_refused_before_work(address, monkeypatch):
    """Nor one that needs certificates, where none are configured; no client is left, which would stop the next one."""
    monkeypatch.setattr("elastid.base.dask_cluster.ANSWER_S", 0.5)
    with refused("workers/cluster"):
        on_dask(address).__enter__()
    assert not any(isinstance(value, distributed.Client) and value.status != "closed" for value in gc.get_objects())
