"""Workers of this machine: Ctrl-C, deaths, errors, rest; values go to each once and stay as long as those here."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest

from elastid.base import workers
from elastid.base.execution import Execution, map_isolated, persistent_workers
from elastid.base.large_arrays import move_to_file
from elastid.base.messages import _NAMES, LostError, PipeEnd, WorkerConstant
from elastid.base.workers import REST, WorkerState

LOADING = """
import os, signal, sys
from elastid.base.execution import Execution
from elastid.base.workers import load_for_workers
if __name__ == "__main__":
    signal.signal(signal.SIGINT, lambda *_: None)
    load_for_workers(["elastid.app.stages.fit"])
    os.killpg(0, signal.SIGINT)
    print(Execution(2).ordered(abs, [-1, -2]))
"""


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="there are no groups of processes")
def test_ctrl_c_while_workers_load_is_for_their_parent(tmp_path: Path):
    """The process that they are copies of shows no traceback of its own, and works on."""
    (tmp_path / "script.py").write_text(LOADING)
    command = [sys.executable, str(tmp_path / "script.py")]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, start_new_session=True)
    assert (run.stdout, run.stderr) == ("[1, 2]\n", "")


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_while_a_worker_starts_leaves_none_behind(monkeypatch: pytest.MonkeyPatch):
    start, started = BaseProcess.start, []

    def pressed(process: BaseProcess):
        if not started:
            signal.raise_signal(signal.SIGINT)
            time.sleep(0.1)
        start(process)
        started.append(process)

    monkeypatch.setattr(BaseProcess, "start", pressed)
    with pytest.raises(KeyboardInterrupt):
        Execution(2).ordered(time.sleep, [60, 60])
    assert len(started) == 1
    assert not any(process.is_alive() for process in started)


def large(item: int) -> bytes:
    """More than a pipe holds, so that a worker is at its answer for most of the time; the first one is killed."""
    if item == 0:
        time.sleep(0.02)
        os._exit(9)
    return bytes(20_000_000)


def test_workers_terminated_amid_answer_are_not_awaited():
    """A pool of the standard library waits for ever for the rest of the answer."""
    for _ in range(5):
        survivors = map_isolated(large, list(range(30)), 2)
        assert [*islice(survivors, 4)]
        survivors.close()
    assert dict(map_isolated(large, [0, 1], 2)) == {0: None, 1: bytes(20_000_000)}


class Unsendable(Exception):
    """An error that does not come whole through a pipe."""

    def __init__(self, first: int, second: int) -> None:
        super().__init__(first)


def unsendable(item: int) -> object:
    if item == 1:
        raise Unsendable(1, 2)
    if item == 4:
        raise ValueError("holds what does not pickle", lambda: item)
    return (lambda: item) if item == 2 else item


@pytest.mark.parametrize(("item", "said"), [(1, "Unsendable"), (2, "pickle|local object"), (4, "holds what does not")])
def test_an_error_or_value_that_does_not_pickle_is_told(item: int, said: str):
    """And not waited for."""
    with pytest.raises(Exception, match=said):
        Execution(2).ordered(unsendable, [0, item, 3])


def test_an_error_in_a_worker_shows_where_it_arose():
    with pytest.raises(ZeroDivisionError) as error:
        Execution(2).ordered((1).__divmod__, [1, 0])
    assert "in a worker:\nTraceback" in str(error.value.__cause__)


def process_of(item: Path) -> int:
    """The process of one of two items of a folder; each waits until the other one begins."""
    item.touch()
    while len(list(item.parent.iterdir())) < 2:
        time.sleep(0.01)
    return os.getpid()


def two_processes(folder: Path) -> set[int]:
    """The processes of two items that are worked out at the same time."""
    folder.mkdir()
    return set(Execution(2).ordered(process_of, [folder / "1", folder / "2"]))


def wait_for_end(processes: Iterable[int]) -> None:
    """Of each within 30 s: its parent, the process of which workers are copies, takes note of it in its own time."""
    for process in processes:
        for _ in range(3000):
            try:
                os.kill(process, 0)
            except ProcessLookupError:
                break
            time.sleep(0.01)
        else:
            pytest.fail(f"process {process} is still there")


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="asks for processes as POSIX does")
def test_lasting_workers_stay_for_the_next_work_and_no_longer(tmp_path: Path):
    """One that is killed between two works is replaced, and no work is lost by that."""
    with persistent_workers():
        first = two_processes(tmp_path / "first")
        assert two_processes(tmp_path / "second") == first
        killed = min(first)
        os.kill(killed, signal.SIGKILL)
        wait_for_end([killed])
        assert dict(map_isolated(abs, [-1, -2, -3], 2)) == {0: 1, 1: 2, 2: 3}
        with pytest.raises(ZeroDivisionError):
            Execution(2).ordered((1).__divmod__, [1, 0])
        assert Execution(2).ordered(abs, [-1, 2]) == [1, 2]
        last = two_processes(tmp_path / "last")
        assert len(last) == 2
    wait_for_end(first | last)


def test_workers_start_anew_where_there_is_no_process_to_copy(monkeypatch: pytest.MonkeyPatch):
    """As on Windows: the same values."""
    monkeypatch.setattr(workers, "get_all_start_methods", lambda: ["spawn"])
    assert workers.start_method() == "spawn"
    workers.load_for_workers(["elastid.fit"])
    assert Execution(2).ordered(abs, list(range(-4, 0))) == [4, 3, 2, 1]


@dataclass(frozen=True, eq=False)
class Data(WorkerConstant):
    """An array that does not change, and the process that first worked something out of it."""

    values: np.ndarray

    @cached_property
    def worked_out_by(self) -> int:
        return os.getpid()


def data(n: int) -> Data:
    values = np.zeros(n)
    values.flags.writeable = False
    return Data(values)


def length(item: Data) -> int:
    return len(item.values)


def processes(item: Data) -> tuple[int, int]:
    return item.worked_out_by, os.getpid()


def doubled(item: Data) -> Data:
    return data(2 * len(item.values))


def without_sum(item: Data) -> None:
    raise ArithmeticError(f"no sum of {len(item.values)}")


@pytest.fixture
def sent(monkeypatch) -> list[int]:
    """Bytes of each message that leaves this process."""
    sizes, send = [], Connection.send_bytes

    def counted(self, message, *further):
        sizes.append(len(message))
        send(self, message, *further)

    monkeypatch.setattr(Connection, "send_bytes", counted)
    return sizes


def test_value_goes_to_a_process_once_and_never_back(sent):
    """What is worked out stays there; the successor of a process that dies is given them again."""
    items = [data(n) for n in (10_000, 20_000, 30_000)]
    with persistent_workers():
        there = Execution(2)
        assert list(there.with_affinity(length, items)) == [10_000, 20_000, 30_000]
        assert 0 < sum(sent) - sum(item.values.nbytes for item in items) < 5 * 500
        sent.clear()
        (first, one), (second, other), (third, again) = there.with_affinity(processes, items)
        assert (first, second, third) == (one, other, again)
        assert one != other == again != os.getpid()
        twice = list(there.with_affinity(doubled, items))
        assert list(there.with_affinity(length, twice)) == [20_000, 40_000, 60_000]
        assert sum(sent) < 15 * 500
        os.kill(one, signal.SIGKILL)
        with pytest.raises(ArithmeticError, match="no sum of 10000"):
            list(there.with_affinity(without_sum, items))
        assert list(there.with_affinity(length, items)) == [10_000, 20_000, 30_000]


def test_unknown_name_from_other_end_is_refused(tmp_path: Path):
    """Also for an array in a temporary file; the second message contains its name alone."""
    item, here, there = data(10_000), PipeEnd(keeps=False), PipeEnd(keeps=True)
    stored = move_to_file(tmp_path, item.values)
    arrived = there.unpack(here.pack([item, item.values, stored]))
    assert arrived[1] is arrived[0].values
    named = bytes(here.pack([item, stored]))
    assert len(named) < 500
    assert there.unpack(named)[0] is item
    with pytest.raises(LostError):
        there.unpack(named.replace(_NAMES[id(item)], bytes(8)))


def test_worker_keeps_function_until_it_rests():
    """The first message contains the function; after the rest, an item without a function is refused."""
    here, served = PipeEnd(keeps=False), WorkerState()
    assert here.unpack(served.answer(here.pack((abs, -2), True))).result == 2
    assert here.unpack(served.answer(here.pack((None, -3)))).result == 3
    assert served.answer(REST) is None
    with pytest.raises(LostError):
        served.answer(here.pack((None, -3)))
