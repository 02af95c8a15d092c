"""Values that stay at workers: each goes to one of them once, is asked for there, and goes with the one here."""

import gc
import os
import signal
from dataclasses import dataclass
from functools import cached_property
from multiprocessing.connection import Connection

import numpy as np
import pytest

from elastid.base.execution import Execution
from elastid.base.workers import _NAMES, End, Kept, LostError, lasting_workers


@dataclass(frozen=True, eq=False)
class Data(Kept):
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


def test_each_value_goes_to_one_process_once_and_what_comes_from_there_does_not_go_back(sent):
    """What is worked out stays there; the successor of a process that dies is given them again."""
    items = [data(n) for n in (10_000, 20_000, 30_000)]
    with lasting_workers():
        there = Execution(2)
        assert list(there.at_home(length, items)) == [10_000, 20_000, 30_000]
        assert 0 < sum(sent) - sum(item.values.nbytes for item in items) < 5 * 500
        sent.clear()
        (first, one), (second, other), (third, again) = there.at_home(processes, items)
        assert (first, second, third) == (one, other, again)
        assert one != other == again != os.getpid()
        twice = list(there.at_home(doubled, items))
        assert list(there.at_home(length, twice)) == [20_000, 40_000, 60_000]
        assert sum(sent) < 15 * 500
        os.kill(one, signal.SIGKILL)
        with pytest.raises(ArithmeticError, match="no sum of 10000"):
            list(there.at_home(without_sum, items))
        assert list(there.at_home(length, items)) == [10_000, 20_000, 30_000]


def lives(item: Data) -> int:
    return sum(type(value) is Data for value in gc.get_objects())


def test_a_value_that_is_gone_here_is_gone_there():
    """With the next message."""
    with lasting_workers():
        items = [data(1000), data(1000)]
        assert list(Execution(2).at_home(lives, items)) == [1, 1]
        assert list(Execution(2).at_home(lives, [data(1000), items[1]])) == [2, 1]
        del items
        assert list(Execution(2).at_home(lives, [data(1000), data(1000)])) == [1, 1]


def test_a_name_of_what_the_other_end_does_not_have_is_no_value():
    item, here, there = data(10_000), End(keeps=False), End(keeps=True)
    arrived = there.unpacked(here.packed([item, item.values]))
    assert arrived[1] is arrived[0].values
    named = bytes(here.packed(item))
    assert len(named) < 500
    assert there.unpacked(named) is item
    with pytest.raises(LostError):
        there.unpacked(named.replace(_NAMES[id(item)], bytes(8)))
