"""Logs as text, and the study that `elastid new` writes of them."""

from pathlib import Path

import numpy as np

from elastid.app import cli
from elastid.base.arrays import FloatArray
from elastid.study import Study, load_with_logs


def save(path: Path, head: str, *columns: FloatArray) -> Path:
    """A text of headings and columns, (n,) or (n, m)."""
    np.savetxt(path, np.column_stack(columns), "%.12g", ",", header=head, comments="")
    return path


def drafted(folder: Path, *sources: Path | str) -> Study:
    """The study in the folder `new` that `elastid new` writes of logs and robots, as `check` accepts it."""
    words = [word for path in sources for word in ("--from", str(path))]
    assert cli.run_command(["new", str(folder / "new"), *words]) == 0
    return load_with_logs(folder / "new" / "study.yml").study
