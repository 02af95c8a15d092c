"""Work in processes: what is to be done travels once to each, what it is done with every time."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from plants.refusals import refused

from elastid.base.execution import Execution, map_isolated


def test_script_without_main_guard_is_refused_in_workers(tmp_path: Path):
    """The workers read the script again, and would start workers of their own."""
    script = tmp_path / "script.py"
    work = "print(Execution(2).ordered(abs, [-1, -2]))\n"
    script.write_text(f"from elastid.base.execution import Execution\n{work}")
    run = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60)
    assert run.returncode != 0
    assert "ElastidError: " in run.stderr
    assert "if __name__ == '__main__':" in run.stderr
    script.write_text(f"from elastid.base.execution import Execution\nif __name__ == '__main__':\n    {work}")
    assert subprocess.run([sys.executable, str(script)], capture_output=True, text=True).stdout == "[1, 2]\n"


def killed_at_two(item: int) -> int:
    """As if the system had killed the worker for lack of memory."""
    if item == 2:
        os._exit(9)
    return item * item


@pytest.mark.parametrize("jobs", [1, 2])
def test_dead_worker_costs_only_its_item(jobs: int):
    """None in its place, and all others as they are."""
    assert dict(map_isolated(killed_at_two, [1, 2, 3, 4, 5], jobs)) == {0: 1, 1: None, 2: 9, 3: 16, 4: 25}


def dying_once(item: tuple[int, str]) -> int:
    """The square of a number; who is the first at 3 is killed there."""
    number, folder = item
    if number == 3:
        try:
            (Path(folder) / "died").touch(exist_ok=False)
        except FileExistsError:
            return number**2
        os._exit(9)
    return number**2


def test_work_of_a_worker_that_dies_is_done_anew(tmp_path: Path):
    """All values are there, once each, as if it had lived."""
    steps = []
    execution = Execution(2, lambda *step: steps.append(step))
    assert execution.ordered(dying_once, [(i, str(tmp_path)) for i in range(8)]) == [i**2 for i in range(8)]
    assert steps == [(done, 8) for done in range(9)]
    assert (tmp_path / "died").exists()


def test_workers_that_die_again_and_again_are_given_up():
    with refused("workers/died"):
        Execution(2).ordered(os._exit, [9, 9])


def test_checkpoint_spares_finished_items_and_progress_counts_them():
    """A pickled execution has no workers: workers do not start workers."""
    steps, finished = [], {"b": 20}
    execution = Execution(1, lambda done, total: steps.append((done, total)), finished)
    assert execution.resumed(abs, [-1, -2, -3], ["a", "b", "c"]) == [1, 20, 3]
    assert steps == [(1, 3), (2, 3), (3, 3)]
    assert finished == {"a": 1, "b": 20, "c": 3}
    assert [Execution(jobs).is_shared(n) for jobs, n in ((0, 9), (1, 9), (2, 1), (2, 2))] == [0, 0, 0, 1]
    assert pickle.loads(pickle.dumps(Execution(4))).jobs == 0
