"""elastid export: every target of a finished fit, the same bytes twice."""

from pathlib import Path

import pytest

from elastid.app.cli import run_command
from elastid.app.export import TARGETS


@pytest.mark.slow
def test_the_command_writes_the_same_bytes_twice_and_wants_a_fit(
    tiny: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    assert run_command(["export", str(tiny), "--to", "csv", "--run", str(run)]) == 2
    assert "estimate` first" in capsys.readouterr().err
    assert run_command(["run", str(tiny), "design", "measure", "estimate", "fit", "--run", str(run), "-q"]) == 0
    for target in (*TARGETS, "actuators"):
        contents = []
        for _ in range(2):
            assert run_command(["export", str(tiny), "--to", target, "--run", str(run)]) == 0
            files = sorted((run / "export" / target).iterdir())
            contents.append([(file.name, file.read_bytes()) for file in files])
        assert contents[0] == contents[1]
        assert len(contents[0]) >= 1
