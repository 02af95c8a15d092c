"""A stage is handed what its row declares, and its stamp is the hash of that and of everything that is packaged."""

import inspect
import json
import pickle
import shutil
from collections.abc import Iterator
from copy import copy
from dataclasses import asdict, fields, is_dataclass, replace
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import pytest

import elastid
from elastid.app import work
from elastid.app.scaffold import new
from elastid.app.stage_table import STAGES, Stage, stages_of_study
from elastid.app.work import StudyFiles, code_hash, handed_values, stamps
from elastid.study import LoadedStudy, load

PACKAGE = Path(elastid.__file__).parent
# Properties of Study that rows read, and the sections of which they are made.
DERIVED = {"seeded_fit": ("fit", "seed"), "places": ("robot", "experiment"), "friction_joints": ("robot", "friction")}
TEMPLATES = ("serial", "parallel-linkage", "recorded", "frf", "friction")


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, LoadedStudy]:
    """A study of each template that comes with its files; the friction study with a filter, the first with a design."""
    home = tmp_path_factory.mktemp("studies")
    options = {"friction": ("filter={}",), "serial": ("design={count: 1}",)}
    return {name: load(new(home / name, name), options.get(name, ())) for name in TEMPLATES}


@pytest.fixture(autouse=True)
def same_code(monkeypatch: pytest.MonkeyPatch) -> None:
    """Thousands of stamps without reading the package each time."""
    monkeypatch.setattr(work, "code_hash", lambda: 64 * "0")


@pytest.mark.parametrize("kind", [".py", ".pyi", ".c", ".h", ".m", ".j2", ".js", ".css", ".yml", ".txt", ".typed", ""])
def test_a_byte_of_any_packaged_file_changes_the_hash_of_the_code(tmp_path: Path, kind: str) -> None:
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


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: stage.function)
def test_a_stage_takes_the_values_of_its_row_and_nothing_else(stage: Stage) -> None:
    """By keyword; none of them is a study or a run, through which it would reach the rest."""
    parameters = inspect.signature(resolve_name(stage.function)).parameters
    declared = {value.argument for value in stage.values} | {source.argument for source in stage.sources} | {"work"}
    declared |= {"files"} if stage.files is not None else set()
    optional = {name for name, parameter in parameters.items() if parameter.default is not inspect.Parameter.empty}
    assert declared <= set(parameters)
    assert set(parameters) - declared <= optional  # of stages that another kind of study has
    assert all(parameter.kind is inspect.Parameter.KEYWORD_ONLY for parameter in parameters.values())
    assert not {"Study", "LoadedStudy", "Run"} & {str(parameter.annotation) for parameter in parameters.values()}


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


def is_declared(stage: Stage, path: tuple[Any, ...]) -> bool | None:
    """True if a row reads a key as it stands, False if it does not, None if it may through a property of the study."""
    through_property = False
    for value in stage.values:
        names = tuple(value.name.split("."))
        through_property |= path[0] in DERIVED.get(value.name, ())
        if path[: len(names)] == names and (len(path) == len(names) or path[len(names)] not in value.without):
            return True
    return None if through_property else False


def as_json(loaded: LoadedStudy, stage: Stage) -> str:
    handed = handed_values(loaded, stage)
    return json.dumps({name: value for name, value in handed.items() if name != "files"}, default=asdict)


def is_plain(path: tuple[Any, ...]) -> bool:
    """Keys that neither name files nor joints: without these a study has no kind and no values any more."""
    return path[0] != "robot" and not {"files", "frf"} & set(path) and path[:2] != ("friction", "joints")


@pytest.mark.parametrize("template", TEMPLATES)
@pytest.mark.slow
def test_each_key_reaches_the_stages_that_declare_it_and_their_successors(
    studies: dict[str, LoadedStudy], template: str
) -> None:
    """For every key of the study: handed over and in the stamp where it is declared, in neither where it is not."""
    loaded = studies[template]
    stages, before = stages_of_study(loaded.study), stamps(loaded)
    tried = [path for path in keys(loaded.study) if is_plain(path)]
    assert len(tried) > 50
    for path in tried:
        other = replace(loaded, study=changed(loaded.study, path))
        try:
            after = stamps(other)
        except (ValueError, KeyError, TypeError):  # a section that is made again refuses such a value
            continue
        for name, stage in stages.items():
            same = as_json(other, stage) == as_json(loaded, stage)
            if (declared := is_declared(stage, path)) is not None:
                assert same is not declared, (path, name)
            sources = [source for source in stage.sources if source.stage in stages]
            upstream = any(after[s.stage].inputs != before[s.stage].inputs for s in sources)
            assert (after[name].inputs != before[name].inputs) is (not same or upstream), (path, name)


def test_only_declared_files_of_the_study_are_reached(tmp_path: Path) -> None:
    """In workers, too."""
    files = pickle.loads(pickle.dumps(StudyFiles(tmp_path, ("logs/a.csv",))))
    assert files / "logs/a.csv" == tmp_path / "logs" / "a.csv"
    with pytest.raises(LookupError, match="must name it under files"):
        files / "robot.yml"


def test_the_content_of_a_log_changes_the_stamp_of_its_records(studies: dict[str, LoadedStudy]) -> None:
    """One byte of one file, whatever its date."""
    loaded = studies["recorded"]
    before = stamps(loaded)
    log = min((loaded.base / "logs").iterdir())
    content = log.read_bytes()
    log.write_bytes(content[:-2] + bytes([content[-2] ^ 1]) + content[-1:])
    try:
        after = stamps(loaded)
    finally:
        log.write_bytes(content)
    assert all(after[name].inputs != before[name].inputs for name in before)
