"""Items at workers: each goes to one of them, and what is asked of all comes back in order."""

import os
import pickle

import pytest
from plants.refusals import refused

import elastid.base.placed as placed
from elastid.base.execution import Execution
from elastid.base.placed import Placed


def length(item: bytes) -> int:
    return len(item)


def process(item: object) -> int:
    return os.getpid()


def doubled(item: bytes) -> bytes:
    return 2 * item


def without_sum(item: bytes) -> None:
    raise ArithmeticError(f"no sum of {len(item)}")


class DyingAt:
    """The length of an item; the process that has the one of a length dies, so many times."""

    def __init__(self, folder, size: int, times: int) -> None:
        self.folder, self.size, self.times = folder, size, times

    def __call__(self, item: bytes) -> int:
        deaths = len(list(self.folder.iterdir()))
        if len(item) == self.size and deaths < self.times:
            (self.folder / str(deaths)).touch()
            os._exit(1)
        return len(item)


def test_each_item_goes_to_one_process_once_and_is_asked_and_changed_there(monkeypatch, tmp_path):
    """Bytes of what is asked do not grow with those of the items; the successor of a process that dies has them."""
    sent = []
    passed_on = placed.answers

    def weighed(given):
        sent.extend(len(message) for _, message in given.values())
        return passed_on(given)

    monkeypatch.setattr(placed, "answers", weighed)
    items = [bytes(n) for n in (100_000, 200_000, 300_000)]
    there = Placed(items, Execution(2))
    assert sum(sent) < sum(map(len, items)) + 3 * 500
    sent.clear()
    assert there.ask(length) == [100_000, 200_000, 300_000]
    processes = there.ask(process)
    assert processes[0] != processes[1] == processes[2]
    assert os.getpid() not in processes
    there.change([2 * item for item in items], [doubled] * 3)
    assert sum(sent) < 6 * 500
    assert there.ask(DyingAt(tmp_path, 600_000, 2)) == [200_000, 400_000, 600_000]
    assert len(list(tmp_path.iterdir())) == 2
    with pytest.raises(ArithmeticError, match="no sum of 200000"):
        there.ask(without_sum)
    assert there.ask(length) == [200_000, 400_000, 600_000]
    assert pickle.loads(pickle.dumps(Placed([b""], Execution(1)))) is None


def test_an_item_at_which_every_worker_dies_is_a_sentence(tmp_path):
    """Not a loop without an end."""
    there = Placed([b"", b"12"], Execution(2))
    with refused("workers/died"):
        there.ask(DyingAt(tmp_path, 2, 99))
