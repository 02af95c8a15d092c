"""Table of the targets of `elastid export`, with targets of installed packages (entry points elastid.targets).

A further target is a file with a row `Target`, and its tag here. Modules are named as text, so that the command line
does not import them.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from elastid.targets.target import Target

GROUP = "elastid.targets"
MODULES = {
    "robot": "elastid.app.identified_robot", "control": "elastid.targets.control", "matlab": "elastid.targets.matlab",
    "mujoco": "elastid.targets.mujoco", "fmu": "elastid.targets.fmu", "urdf": "elastid.targets.urdf",
    "casadi": "elastid.targets.code", "c": "elastid.targets.code", "csv": "elastid.targets.csv",
    "uff": "elastid.targets.uff", "samples": "elastid.targets.draws", "observer": "elastid.targets.friction",
    "compensation": "elastid.targets.friction", "actuators": "elastid.targets.actuators"
}  # fmt: skip


def tags() -> tuple[str, ...]:
    """Return the tags of all targets."""
    return (*MODULES, *(entry.name for entry in _package_targets()))


def targets(tag: str) -> tuple["Target", ...]:
    """Return the rows of a tag, in the order of preference; none for an unknown tag."""
    if tag in MODULES:
        return tuple(row for row in import_module(MODULES[tag]).TARGETS if row.tag == tag)
    from elastid.base.entry_points import load_row
    from elastid.targets.target import Target

    return tuple(load_row(entry, Target) for entry in _package_targets() if entry.name == tag)


def explain_targets(tag: str = "") -> str:
    """Explain a target, or all of them: the files' content and the arguments of its function."""
    from elastid.base.display import capitalise

    rows = [row for name in ([tag] if tag else tags()) for row in targets(name)]
    texts = (f"{capitalise(row.content)}.\n  Arguments of its function: {', '.join(row.arguments)}." for row in rows)
    return "\n".join(f"{row.tag}\n  {text}" for row, text in zip(rows, texts, strict=True))


def _package_targets() -> "tuple[EntryPoint, ...]":
    from elastid.base.entry_points import group_entries

    return tuple(entry for entry in group_entries(GROUP) if entry.name not in MODULES)
