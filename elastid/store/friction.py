"""Friction in frf.h5: what was found in the records and taken out of their torque."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.shapes import Shape
from elastid.store.files import opened, read_notes, scale, texts, variable, write_notes

# Beside the groups of the configurations, whose names are escaped: none begins with %.
_GROUP = "%friction"


def write_friction(file: Any, friction: FrictionTakenOut) -> None:
    """The group of the friction that was taken out."""
    group = file.create_group(_GROUP)
    places = scale(group, "place", friction.places, "motor")
    variable(group, "place_units", friction.place_units, [places], "unit of its torque")
    shape = scale(group, "shape", list(range(len(friction.shapes))), "shape of friction")
    variable(group, "shape_place", [each.place for each in friction.shapes], [shape], "motor that it acts on")
    variable(group, "shape_kind", [each.kind for each in friction.shapes], [shape], "kind of the shape")
    thresholds = [each.threshold for each in friction.shapes]
    variable(group, "threshold", thresholds, [shape], "distance over which a bristle bends, link side", "rad")
    variable(group, "levels", friction.levels, [shape], "level of each shape, link side, 0 where not taken out", "N*m")
    variable(group, "covariance", friction.covariance, [shape, shape], "covariance of the levels")
    configurations = scale(group, "configuration", friction.configurations, "configuration")
    axes = [configurations, places]
    variable(
        group, "before", friction.before, axes, "amplitude of torque that no response explains, median line", "N*m"
    )
    variable(group, "after", friction.after, axes, "the same with friction taken out", "N*m")
    variable(group, "kept_share", friction.kept_share, [places], "share of its power left in other realisations")
    variable(group, "accelerance", friction.accelerance, [places], "acceleration per torque at the highest lines")
    write_notes(group, friction.notes)


def read_friction(path: Path | str) -> FrictionTakenOut | None:
    """The friction that was taken out of the responses in frf.h5; None where the study asked for none."""
    with opened(path, "frf") as file:
        if _GROUP not in file:
            return None
        group = file[_GROUP]
        kinds = zip(texts(group, "shape_place"), texts(group, "shape_kind"), group["threshold"][:], strict=True)
        return FrictionTakenOut(
            places=texts(group, "place"),
            place_units=texts(group, "place_units"),
            shapes=tuple(Shape(place, kind, float(D)) for place, kind, D in kinds),  # type: ignore[arg-type]
            configurations=texts(group, "configuration"),
            notes=read_notes(group),
            **{
                name: group[name][:]
                for name in ("levels", "covariance", "before", "after", "kept_share", "accelerance")
            },
        )
