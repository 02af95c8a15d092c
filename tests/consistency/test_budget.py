"""The budget of sizes fails where a number exceeds it, and its file only ever goes down."""

import runpy
import tomllib
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "budget.py"
MODULE = '''"""One module."""
LIMIT = 2 * 3.0
class RoomLimits:
    most: int = 4
    name: str = "no number"
def f(x):
    """A docstring of many words, which is not counted."""
    return "a text of words without an end", "A sentence has five words.", f"{x} is more than {x} of it"
'''


def test_a_number_beyond_the_budget_fails_until_it_falls(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By what, where and how much; lowering takes the numbers that fell and leaves the others."""
    main = runpy.run_path(str(SCRIPT))["main"]
    for room in ("elastid", "tests", "scripts"):
        (tmp_path / room).mkdir()
    (tmp_path / "elastid" / "__init__.pyi").write_text("from elastid.robot import Robot as Robot\n")
    (tmp_path / "elastid" / "module.py").write_text(MODULE)
    path = tmp_path / "scripts" / "budget.toml"
    path.write_text("[elastid]\nlines = 7\nthresholds = 9\n")
    assert main(["--lower"], tmp_path) == 1
    assert "elastid: lines: 8, 1 more than the budget of 7" in capsys.readouterr().out
    lowered = tomllib.loads(path.read_text())["elastid"]
    assert lowered.pop("nodes") > 30
    assert lowered == {"lines": 7, "files": 1, "thresholds": 2, "sentences": 2, "commands": 0, "names": 1}
    path.write_text(path.read_text().replace("lines = 7", "lines = 8"))
    assert main([], tmp_path) == 0
