"""Pages that are made from the code: commands, keys of a study, files of a run, public names, equations."""

import ast
import inspect
import itertools
import json
import re
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import click
import matplotlib.pyplot as plt
import numpy as np
from plain_text import escape, list_table, to_rst

import elastid
from elastid.app.cli import cli, run_command
from elastid.app.target_table import MODULES, targets
from elastid.store.description import describe_artefact
from elastid.study.reference import StudyKey, explain, keys_of, list_keys
from elastid.study.sections import Study
from elastid.targets.target import VALUES

PACKAGE = Path(elastid.__file__).parent
BENCHMARK = Path(__file__).parents[1] / "benchmarks" / "open"
# Artefacts of a run that the page of files shows, in the order of the stages.
HDF5 = {"tiny": ("plan.h5",), "recorded": ("records.h5", "frf.h5", "fit.h5", "validation.h5")}


# The headings of a page are names, which style.css sets in the letters of code.
NAMES = ".. rst-class:: names\n"


def title(text: str, line: str = "=") -> str:
    """Return a heading."""
    return f"{text}\n{line * len(text)}\n"


def block(text: str, language: str = "none") -> str:
    """Return a block of text as it is."""
    return f".. code-block:: {language}\n\n" + "\n".join(f"   {line}".rstrip() for line in text.splitlines()) + "\n"


def commands() -> str:
    """Return every command with its arguments and options, from the command line itself."""
    parts = [NAMES, title("Commands"), f"{cli.help} The order is the same as in ``elastid --help``.\n"]
    root = click.Context(cli, info_name="elastid", help_option_names=["-h", "--help"])
    for name in cli.list_commands(root):
        command = cli.commands[name]
        usage = click.Context(command, info_name=name, parent=root)
        parts += [f".. _command-{name}:\n", title(f"elastid {name}", "-"), to_rst(inspect.cleandoc(command.help or ""))]
        parts.append(block(command.get_usage(usage).removeprefix("Usage: "), "bash"))
        records = [option.get_help_record(usage) for option in command.params]
        parts += [f"``{name}``\n   {escape(text)}\n" for name, text in filter(None, records) if text]
    return "\n".join(parts)


def export_targets() -> str:
    """Return every target of `elastid export`: content of its files, and values that a row of a package may need."""
    rows = [(f"``{row.tag}``", escape(row.content)) for tag in MODULES for row in targets(tag)]
    values = [f"``{name}``\n   {escape(meaning)}\n" for name, meaning in VALUES.items()]
    return "\n".join([title("Targets of an export"), list_table(rows, ":widths: 20 80"), _PACKAGE_TARGETS, *values])


def keys() -> dict[str, str]:
    """Return a page for each section of a study, with every key, and their index."""
    by_path = {key.path: key for key in list_keys()}
    texts = {key.name: key.text for key in keys_of(Study)}
    order = list(texts)
    by_section = sorted(by_path.values(), key=lambda key: order.index(_root(key)))
    pages = {}
    for root, of in groupby(by_section, _root):
        parts = [NAMES, title(root)]
        for key in of:
            parts += [*([] if key.path == root else [f".. _key-{key.path}:\n", title(key.path, "-")]), _explain(key)]
        pages[f"keys/{root}"] = "\n".join(parts)
    sections = [root for root in order if f"keys/{root}" in pages]
    head = (
        f"{len(by_path)} keys in the order of a study. ``elastid explain KEY`` prints the same text, and "
        "editors show it with the study.schema.json of ``elastid new``. ``[]`` is the number of an entry, ``<name>`` a "
        "name that you choose.\n"
    )
    table = list_table([(f":doc:`{root}`", escape(texts[root])) for root in sections], ":widths: 20 80")
    toc = ".. toctree::\n   :hidden:\n\n" + "".join(f"   {root}\n" for root in sections)
    pages["keys/index"] = "\n".join([title("Keys of a study"), head, table, toc])
    return pages


def _root(key: StudyKey) -> str:
    return re.split(r"[.\[]", key.path)[0]


_FIELDS = "Value|Default|How to choose it|When to change it|Keys below it|Keys of each"


def _explain(key: StudyKey) -> str:
    """Return the paragraphs of `elastid explain` after the path: a text, and a list of fields."""
    paragraphs: list[str] = []
    for line in explain(key.path).splitlines()[1:]:
        starts = re.match(rf"  ({_FIELDS}): ", line)
        if starts or not paragraphs:
            paragraphs.append(line.strip())
        else:
            paragraphs[-1] += " " + line.strip()
    text, *entries = (re.sub(rf"^({_FIELDS}):", r":\1:", escape(each)) for each in paragraphs)
    return "\n".join([text, "", *entries, ""])


def names() -> dict[str, str]:
    """Return a page for each public name, by autodoc, and their index in the order of the work."""
    pages = {"names/index": title("Public names") + "\n.. toctree::\n\n   " + "\n   ".join(elastid.__all__)}
    for name in elastid.__all__:
        kind = type(getattr(elastid, name)).__name__.replace("type", "class")
        pages[f"names/{name}"] = title(name) + f"\n.. auto{kind}:: elastid.{name}\n"
    return pages


def files(folder: Path) -> str:
    """Return names, axes, shapes and units of every artefact of small runs in `folder`, and keys of summary.json."""
    (folder / "tiny").mkdir()
    (folder / "tiny" / "study.yml").write_text(_TINY)
    (folder / "tiny" / "robot.yml").write_text(_TINY_ROBOT)
    run_command(["new", str(folder / "recorded"), "--template", "recorded"])
    for name, stages in (("recorded", ["measure", "estimate", "fit", "validate"]), ("tiny", ["design"])):
        run = ["--run", str(folder / name / "run"), "--jobs", "1", "-q"]
        if (code := run_command(["run", str(folder / name / "study.yml"), *stages, *run])) not in (0, 3):
            raise RuntimeError(f"the run for the page of files ended with {code}")
    parts = [title("Files of a run"), inspect.cleandoc(_FILES)]
    for name, artefacts in HDF5.items():
        for artefact in artefacts:
            text = "\n".join(_structure(describe_artefact(folder / name / "run" / artefact).splitlines()[1:]))
            parts += [title(artefact, "-"), block(text)]
    summary = json.loads((folder / "recorded" / "run" / "summary.json").read_text())
    parts += [
        title("summary.json", "-"),
        inspect.cleandoc(_SUMMARY),
        block(json.dumps(_shorten(summary), indent=1), "json"),
    ]
    robot = (folder / "recorded" / "run" / "identified_robot.yml").read_text()
    parts += [title("robot.yml", "-"), inspect.cleandoc(_ROBOT), block(robot, "yaml")]
    return "\n\n".join(parts) + "\n"


def _structure(lines: list[str]) -> Iterator[str]:
    """Return names, axes, meanings and units, without the values of one run, but with values of attributes."""
    for line in lines:
        yield re.sub(r"(\)|\]|[a-z]) = .*$", r"\1", line) if "(" in line.split(" = ")[0] else line[:110]


def _shorten(value: object) -> object:
    """Shorten lists to two entries, and numbers to four digits."""
    if isinstance(value, dict):
        return {name: _shorten(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_shorten(each) for each in value[:2]]
    if isinstance(value, float):
        return float(f"{value:.4g}")
    return value


def equations() -> str:
    """Return the page of all equations in docstrings: module, description and equation."""
    parts = [title("Equations"), "This page collects the equations of the docstrings, package by package.\n"]
    rooms = sorted((path for path in PACKAGE.rglob("*.py")), key=lambda path: path.relative_to(PACKAGE).parts)
    for room, paths in groupby(rooms, lambda path: path.relative_to(PACKAGE).parts[0].removesuffix(".py")):
        entries = [entry for path in paths for entry in _with_equations(path)]
        parts += [title(room, "-"), *entries] if entries else []
    return "\n".join(parts)


def _with_equations(path: Path) -> Iterator[str]:
    module = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            doc = ast.get_docstring(node) or ""
            if ".. math::" in doc:
                name = module if isinstance(node, ast.Module) else f"{module}.{node.name}"
                yield f"**{escape(name)}**\n\n{to_rst(doc)}"


_PACKAGE_TARGETS = """
A Python package adds a target with an entry point of the group ``elastid.targets``. The entry point names an
``elastid.targets.target.Target``: tag, names of the values that it needs, content of its files, and its function
``write(folder, **values)``. These are the values:
"""
_FILES = """
Results are HDF5 files. Named axes are dimension scales, complex numbers are native, and every dataset has a unit. The
listings show small runs with one motor, as printed by ``elastid inspect FILE``: name, axes with lengths in
parentheses, meaning, unit in brackets. The attribute ``format`` is the version of the layout. ``provenance`` contains
hashes of all inputs, the seed and the software versions. A SHA-256 checksum before the HDF5 data detects damaged
files; ``checksums.sha256`` contains the checksums of all other files.
"""
_SUMMARY = """
Summary of a fit for other programs. ``schema`` is the version of this format. ``status`` and ``message`` describe the
result. Fixed parameters have no ``std`` and ``interval95``. ``truth`` exists for simulated robots only. This listing
shows two entries per list and four digits per number.
"""
_ROBOT = """
The robot model is a YAML file. :doc:`keys/robot` describes every key. ``identified_robot.yml`` is the same model with
the identified values:
"""
_TINY_ROBOT = """
name: one elastic joint
gravity: [0, 0, 0]
bodies:
  - name: load
    joints:
      - {name: 1, axis: z, motor: {inertia: 1e-3, ratio: 1, viscous: 1e-3}, spring: {stiffness: 50, damping: 0.01}}
    inertia: 1e-3
"""
_TINY = """
name: tiny
robot: robot.yml
excitation: {rate_hz: 500, period: 2 s, band_hz: [2, 80], torque_rms: 0.5}
experiment: {configurations: {bench: [0]}, simulated: {noise: {torque_std: 0.01, angle_std: 1e-6}}}
"""


# Numbers of an entry of the open benchmark: heading, key, digits.
SCORES = (
    ("largest error of k, %", "k_percent"),
    ("largest error of d, %", "d_percent"),
    ("tool error, %", "tool_percent"),
    ("error / std (rms)", "error_over_std"),
    ("CPU, s", "cpu_s"),
)


def open_benchmark(folder: Path) -> str:
    """Return results of the open benchmark by robot and entry, medians over the seeds, as a figure and a table."""
    results = json.loads((BENCHMARK / "results.json").read_text())["open"]
    entries, robots = (list(dict.fromkeys(row[key] for row in results)) for key in ("entry", "robot"))
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    rows = [["robot", "entry", "seeds", "95 % intervals that contain the true value", *(head for head, _ in SCORES)]]
    for (x, robot), (index, entry) in itertools.product(enumerate(robots), enumerate(entries)):
        of = [row for row in results if (row["robot"], row["entry"]) == (robot, entry)]
        if not of:
            continue
        medians = {key: np.median([row[key] for row in of if row[key] is not None] or [np.nan]) for _, key in SCORES}
        inside = f"{sum(row['inside'] for row in of)} of {sum(row['of'] for row in of)}"
        numbers = ["" if np.isnan(value) else f"{value:.2g}" for value in medians.values()]
        rows.append([f"``{robot}``", entry, str(len(of)), inside, *numbers])
        axes.semilogy(x, medians["k_percent"], "osD^"[index], c=f"C{index}")
    for index, entry in enumerate(entries):
        axes.semilogy([], [], "osD^"[index], c=f"C{index}", label=entry)
    axes.set_xticks(range(len(robots)), robots, rotation=30, ha="right")
    axes.set(ylabel="largest error of a stiffness, %", title="Open benchmark: medians over the seeds")
    axes.legend()
    axes.grid(axis="y", alpha=0.3)
    figure.savefig(folder / "open_benchmark.png", dpi=110)
    plt.close(figure)
    text = (
        "Results of ``scripts/benchmarks/open``, made with ``score.py --save``. For each robot and entry: the largest "
        "error of all stiffnesses k and of all dampings d, median over the seeds. :doc:`/howto/neighbours` describes "
        "robots, entries and rules.\n"
    )
    alt = "Largest errors of the stiffnesses by robot and entry."
    picture = f".. image:: /pictures/open_benchmark.png\n   :alt: {alt}\n"
    return "\n".join([title("Open benchmark"), text, picture, list_table(rows)])
