"""Modification indices in fit.h5: an axis of them, and one of the numbers that they free."""

from __future__ import annotations

from typing import Any

import numpy as np

from elastid.fit.modification_index import ModificationIndex
from elastid.store.files import scale, texts, variable

_AXIS, _MEMBER = "modification", "modified_number"
_NUMBERS = {
    "std": "standard deviation of the first step, by the noise",
    "drop": "decrease of V",
    "share": "of what V has beyond the noise",
}


def write_indices(file: Any, indices: tuple[ModificationIndex, ...], free: Any) -> None:
    """Nothing where there are none.  free: the axis of the free parameters."""
    if not indices:
        return
    axis = scale(file, _AXIS, [one.name for one in indices], "what the fit held or read otherwise")
    variable(file, f"{_AXIS}_group", [one.group for one in indices], [axis], "its kind")
    variable(
        file, f"{_AXIS}_alike", [" | ".join(one.alike) for one in indices], [axis], "cannot be distinguished from it"
    )
    place = np.array([one.place for one in indices])
    variable(file, f"{_AXIS}_place", place, [axis], "place in the sequence, 0: freed alone")
    for name, what in _NUMBERS.items():
        variable(file, f"{_AXIS}_{name}", np.array([getattr(one, name) for one in indices]), [axis], what)
    effects = np.array([one.effects for one in indices])
    variable(file, f"{_AXIS}_effects", effects, [axis, free], "implied change of each free parameter, of x")
    members = [(i, j) for i, one in enumerate(indices) for j in range(len(one.members))]
    number = scale(file, _MEMBER, [indices[i].members[j] for i, j in members], "number that is freed")
    for name, what, values in (
        ("of", "the modification that frees it", [i for i, _ in members]),
        ("value", "that it was held at, SI", [indices[i].values[j] for i, j in members]),
        ("step", "its change, of ln p where log", [indices[i].steps[j] for i, j in members]),
        ("log", "whether its step is of ln p", [indices[i].log[j] for i, j in members]),
    ):
        variable(file, f"{_MEMBER}_{name}", np.array(values), [number], what)
    variable(file, f"{_MEMBER}_unit", [indices[i].units[j] for i, j in members], [number], "unit")


def read_indices(file: Any) -> tuple[ModificationIndex, ...]:
    """Those in fit.h5, none where it has none."""
    if _AXIS not in file:
        return ()
    of, values, steps, log = (file[f"{_MEMBER}_{name}"][:] for name in ("of", "value", "step", "log"))
    names, units = np.array(texts(file, _MEMBER), dtype=object), np.array(texts(file, f"{_MEMBER}_unit"), dtype=object)
    columns = {name: file[f"{_AXIS}_{name}"][:] for name in ("place", "effects", *_NUMBERS)}
    found = []
    for i, (name, group, alike) in enumerate(
        zip(texts(file, _AXIS), texts(file, f"{_AXIS}_group"), texts(file, f"{_AXIS}_alike"), strict=True)
    ):
        mine = of == i
        found.append(
            ModificationIndex(
                name=name,
                group=group,
                members=tuple(names[mine].tolist()),
                values=values[mine],
                units=tuple(units[mine].tolist()),
                log=tuple(log[mine].tolist()),
                steps=steps[mine],
                effects=columns["effects"][i],
                alike=tuple(alike.split(" | ")) if alike else (),
                place=int(columns["place"][i]),
                **{key: float(columns[key][i]) for key in _NUMBERS},
            )
        )
    return tuple(found)
