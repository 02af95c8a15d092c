"""A package of another project, as pip installs it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from elastid.base.entry_points import group_entries


@contextmanager
def installed(folder: Path, module: str, code: str, group: str, entry: str) -> Iterator[Path]:
    """The folder of the metadata of a package of one module with one entry point of a group."""
    (folder / f"{module}.py").write_text(code)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module.replace('_', '-')}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{entry}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        group_entries.cache_clear()
        yield info
        group_entries.cache_clear()
