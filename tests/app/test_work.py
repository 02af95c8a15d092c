"""A stage sees the keys that its row declares, and its stamp is the hash of that and of everything that is packaged."""

import shutil
from collections.abc import Iterator
from copy import copy
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pytest

import elastid
from elastid.app import run as work
from elastid.app.run import code_hash, stamps
from elastid.app.scaffold import new
from elastid.app.stage_table import Stage, stages_of_study
from elastid.study import LoadedStudy, load

PACKAGE = Path(elastid.__file__).parent
TEMPLATES = ("serial", "parallel-linkage", "recorded", "frf", "friction")


@pytest.fixture(scope="module")
def studies(tmp_path_factory) -> dict[str, LoadedStudy]:
    """A study of each template that comes with its files; the friction study with a filter, the first with a design."""
    home = tmp_path_factory.mktemp("studies")
    options = {"friction": ("filter={}",), "serial": ("design={count: 1}",)}
    return {name: load(new(home / name, name), options.get(name, ())) for name in TEMPLATES}


@pytest.fixture(autouse=True)
def same_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of stamps without reading the package each time."""
    monkeypatch.setattr(work, "code_hash", lambda: 64 * "0")


@pytest.mark.parametrize("kind", [".py", ".pyi", ".c", ".h", ".m", ".j2", ".js", ".css", ".yml", ".txt", ".typed", ""])
def test_changed_byte_of_package_changes_code_hash(tmp_path: Path, kind: str) -> None:
    """Kernels, pages, templates and data as much as Python; what Python itself leaves there counts nothing."""
    root = Path(shutil.copytree(PACKAGE, tmp_path / "elastid", ignore=shutil.ignore_patterns("__pycache__")))
    before = code_hash(root)
    (root / "__pycache__").mkdir()
    (root / "__pycache__" / "run.pyc").write_bytes(b"compiled")
    assert code_hash(root) == before
    path = next(path for path in sorted(root.rglob("*")) if path.is_file() and path.suffix == kind)
    content = path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]) if content else b"x")
    assert code_hash(root) != before


def keys(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of every number, text and switch in a study."""
    if is_dataclass(value):
        for field in fields(value):
            yield from keys(getattr(value, field.name), (*path, field.name))
    elif isinstance(value, dict):
        for key in value:
            yield from keys(value[key], (*path, key))
    elif isinstance(value, tuple):
        for i, each in enumerate(value):
            yield from keys(each, (*path, i))
    elif value is not None:
        yield path


def changed(value: Any, path: tuple[Any, ...]) -> Any:
    """A copy with another value at a path, unchecked: stamps must not depend on the sense of a study."""
    if not path:
        if isinstance(value, bool):
            return not value
        return value + 1 if isinstance(value, int | float) else f"{value}x"
    step, rest = path[0], path[1:]
    if isinstance(value, dict):
        return {key: changed(each, rest) if key == step else each for key, each in value.items()}
    if isinstance(value, tuple):
        return tuple(changed(each, rest) if i == step else each for i, each in enumerate(value))
    other = copy(value)
    object.__setattr__(other, step, changed(getattr(value, step), rest))
    return other


def is_within_declared(stage: Stage, path: tuple[Any, ...]) -> bool:
    """True if a row reads a key."""
    dotted = [".".join(map(str, path[:n])) for n in range(1, len(path) + 1)]
    declared = {"experiment", *stage.keys.split()}
    return bool(declared & {*dotted}) and not declared & {f"-{key}" for key in dotted}


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.slow
def test_key_changes_stages_that_read_it_and_their_successors(studies: dict[str, LoadedStudy], template: str) -> None:
    """For every key of the study: seen and in the stamp where it is declared, in neither where it is not."""
    loaded = studies[template]
    stages, before = stages_of_study(loaded.study), stamps(loaded)
    # Without keys that name files or joints a study has no kind and no values any more.
    plain = [path for path in keys(loaded.study) if path[0] != "robot" and path[:2] != ("friction", "joints")]
    tried = [path for path in plain if not {"files", "frf"} & set(path)]
    assert len(tried) > 50
    for path in tried:
        other = replace(loaded, study=changed(loaded.study, path))
        try:
            after = stamps(other)
        except (ValueError, KeyError, TypeError):  # a section that is made again refuses such a value
            continue
        for name, stage in stages.items():
            same = stage.select_keys(other.study) == stage.select_keys(loaded.study)
            assert same is not is_within_declared(stage, path), (path, name)
            sources = [source for source in stage.sources if source in stages]
            upstream = any(after[source].inputs != before[source].inputs for source in sources)
            assert (after[name].inputs != before[name].inputs) is (not same or upstream), (path, name)


def test_log_content_changes_stamp_of_records(studies: dict[str, LoadedStudy]) -> None:
    """One byte of one file, whatever its date."""
    loaded = studies["recorded"]
    before = stamps(loaded)
    log = min((loaded.path.parent / "logs").iterdir())
    content = log.read_bytes()
    log.write_bytes(content[:-2] + bytes([content[-2] ^ 1]) + content[-1:])
    try:
        after = stamps(loaded)
    finally:
        log.write_bytes(content)
    assert all(after[name].inputs != before[name].inputs for name in before)
