"""The `model` section of a study."""

from __future__ import annotations

from typing import Literal

from elastid.section import section


@section
class ModelSpec:
    """formulation: how the robot becomes equations (default: what suits the robot); `serial` for a tree of bodies."""

    formulation: Literal["serial"] | None = None
