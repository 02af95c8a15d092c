"""A robot as the text of a robot's file, from which the same robot is read."""

from __future__ import annotations

import io
import math
from dataclasses import MISSING, fields, is_dataclass
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq
from ruamel.yaml.scalarstring import SingleQuotedScalarString

from elastid.base.escape import comment_lines
from elastid.robot import Robot

# Texts that readers of the older YAML 1.1 take for true and false.
_YAML_1_1_WORDS = ("yes", "no", "on", "off", "y", "n")


def robot_text(robot: Robot, comments: tuple[str, ...] = ()) -> str:
    """YAML of a robot, in SI, keys at their defaults left out; comments: lines at its head."""
    yaml = YAML()
    yaml.width = 100_000
    yaml.indent(mapping=2, sequence=4, offset=2)
    stream = io.StringIO()
    yaml.dump(_plain(robot), stream)
    return "".join(comment_lines(line, "# ") for line in comments) + stream.getvalue()


def _plain(value: Any) -> Any:
    """Mappings, lists, numbers and texts; a number keeps all its digits."""
    if is_dataclass(value) and not isinstance(value, type):
        found = {}
        for field in fields(value):
            own, default = getattr(value, field.name), field.default
            if field.default_factory is not MISSING:
                default = field.default_factory()
            if own is not None and (default is MISSING or own != default) and not _is_unlimited(own):
                found[field.name] = _plain(own)
        return found
    if isinstance(value, tuple):
        inner = CommentedSeq(map(_plain, value))
        if all(not isinstance(each, dict) for each in inner):
            inner.fa.set_flow_style()
        return inner
    if isinstance(value, str) and value.lower() in _YAML_1_1_WORDS:
        return SingleQuotedScalarString(value)
    if isinstance(value, bool | int | str):
        return value
    return float(value)


def _is_unlimited(value: Any) -> bool:
    """No limit, which a file cannot say but by leaving it out."""
    return isinstance(value, float) and math.isinf(value)
