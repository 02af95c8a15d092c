"""Export to universal files (UFF): responses (data set 58), modes (55), and geometry (units 164, nodes 15, lines 82).

Names in a data set have at most ten letters, so places become nodes: `3z` (or `tip 3z`) is node 3 along z; `tip x` is
the next free node along x, and `tip y` the same node along y; any other name is the next free node without a direction.
A geometry defines the point and the direction of a place. nodes.csv lists all nodes. Needs pyuff (the extra `uff`).
"""

import re
import warnings
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from elastid.base.errors import require_package
from elastid.base.escape import file_name, uff_text
from elastid.base.files import replacing
from elastid.modal.modes import Modes
from elastid.modal.spec import GeometrySpec
from elastid.record import Motion
from elastid.response import Response
from elastid.store.files import write_rows
from elastid.targets.target import Target

Nodes: TypeAlias = dict[str, tuple[int, int]]  # node and direction of each place
_DIRECTIONS = ("", "x", "y", "z", "rx", "ry", "rz")
# Ordinate types of data set 58 by quantity; inputs are forces or unknown.
_ORDINATES: dict[Motion, int] = {"position": 8, "velocity": 11, "acceleration": 12}
_FORCE, _UNKNOWN = 13, 0
# Codes of data set 55: structural model, complex eigenvalues of first order, translations.
_STRUCTURAL, _COMPLEX_MODES, _TRANSLATIONS = 1, 3, 2
_FREQUENCY, _FREQUENCY_RESPONSE, _COMPLEX_DOUBLE = 18, 4, 6


def write_uff(
    folder: Path, name: str, responses: Sequence[Response], modes: Sequence[Modes] = (),
    geometry: GeometrySpec | None = None,
) -> tuple[Path, ...]:  # fmt: skip
    """Write <configuration>.uff for each response, with its modes if there are any, and nodes.csv.

    geometry: points and lines of the structure, written to each file.  StudyError if pyuff is not installed.
    """
    pyuff = require_package("pyuff", "uff")
    locations = dict.fromkeys(location for response in responses for location in (*response.outputs, *response.inputs))
    nodes, points = _node_axes(list(locations), geometry)
    folder.mkdir(parents=True, exist_ok=True)
    paths, mode_sets = [], {basis.configuration: basis for basis in modes}
    for response in responses:
        path = folder / f"{file_name(response.configuration.name)}.uff"
        with replacing(path) as temporary, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            # Text files, since pyuff overwrites binary files with their headers only.
            sets = [*_geometry_sets(geometry, points), *_response_sets(name, response, nodes)]
            if response.configuration.name in mode_sets:
                sets += _mode_sets(name, mode_sets[response.configuration.name], nodes)
            pyuff.UFF(str(temporary)).write_sets(sets, "overwrite")
        paths.append(path)
    table = folder / "nodes.csv"
    rows = [(location, node, "-" * (code < 0) + _DIRECTIONS[abs(code)]) for location, (node, code) in nodes.items()]
    write_rows(table, [("place", "node", "direction"), *rows])
    return (*paths, table)


def nodes_of(locations: Iterable[str]) -> Nodes:
    """Return a unique node and direction of each place: 0 none, 1 to 3 along x, y, z, 4 to 6 about x, y, z."""
    names = list(dict.fromkeys(locations))
    matches = {name: re.fullmatch(r"(?:.*\D)?(\d{1,9})(r?[xyz])", name) for name in names}
    nodes = {name: (int(m[1]), _DIRECTIONS.index(m[2])) for name, m in matches.items() if m}
    nodes = {name: node for i, (name, node) in enumerate(nodes.items()) if node not in list(nodes.values())[:i]}
    first = 1 + max((node for node, _ in nodes.values()), default=0)
    points: dict[str, int] = {}
    for name in (name for name in names if name not in nodes):
        point, _, direction = name.rpartition(" ")
        is_directed = direction in _DIRECTIONS and bool(point)
        node = points.setdefault(point if is_directed else name, first + len(points))
        nodes[name] = (node, _DIRECTIONS.index(direction) if is_directed else 0)
    return nodes


def _node_axes(places: Sequence[str], geometry: GeometrySpec | None) -> tuple[Nodes, dict[str, int]]:
    """Return the node and the signed direction of each place, and the node of each point of the geometry."""
    if geometry is None:
        return nodes_of(places), {}

    def at(point: str, direction: str) -> str:
        return f"{point}{direction}" if point.isdigit() else f"{point} {direction}"

    axes = {place: axis for place in places if (axis := geometry.direction_of(place)) is not None}
    names = {place: at(point, direction.lstrip("+-")) for place, (point, direction) in axes.items()}
    nodes = nodes_of((*(names.get(place, place) for place in places), *(at(point, "x") for point in geometry.points)))
    signs = {place: -1 if direction.startswith("-") else 1 for place, (_, direction) in axes.items()}
    node_of = {place: nodes[names.get(place, place)] for place in places}
    signed_nodes = {place: (node, signs.get(place, 1) * code) for place, (node, code) in node_of.items()}
    return signed_nodes, {point: nodes[at(point, "x")][0] for point in geometry.points}


def _geometry_sets(geometry: GeometrySpec | None, points: dict[str, int]) -> Iterable[dict[str, Any]]:
    if geometry is None:
        return
    yield {
        "type": 164, "units_code": 1, "units_description": "SI: m, N", "temp_mode": 1,
        "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15,
    }  # fmt: skip
    x, y, z = np.array([geometry.points[point] for point in points], dtype=float).T
    yield {"type": 15, "node_nums": list(points.values()), "x": x, "y": y, "z": z}
    for i, (first, last) in enumerate(geometry.lines or pairwise(points), start=1):
        nodes = np.array([points[first], points[last]])
        yield {"type": 82, "trace_num": i, "n_nodes": 2, "id": f"line {i}", "nodes": nodes}


def _response_sets(name: str, response: Response, nodes: Nodes) -> Iterable[dict[str, Any]]:
    for i, output in enumerate(response.outputs):
        for j, input_ in enumerate(response.inputs):
            yield {
                "type": 58, "binary": 0, "func_type": _FREQUENCY_RESPONSE, "id1": uff_text(f"{output} to {input_}"),
                "id2": uff_text(name), "id3": "NONE", "id4": uff_text(response.configuration.name),
                "id5": uff_text(response.unit), "rsp_ent_name": "NONE", "ref_ent_name": "NONE",
                "rsp_node": nodes[output][0], "rsp_dir": nodes[output][1], "ref_node": nodes[input_][0],
                "ref_dir": nodes[input_][1], "abscissa_spec_data_type": _FREQUENCY,
                "ordinate_spec_data_type": _ORDINATES[response.quantity],
                "orddenom_spec_data_type": _FORCE if response.units_of_inputs[j] in ("N", "N*m") else _UNKNOWN,
                "ord_data_type": _COMPLEX_DOUBLE, "abscissa_spacing": 0, "abscissa_min": float(response.freq_hz[0]),
                "abscissa_inc": 0.0, "data": response.G[:, i, j], "x": response.freq_hz,
            }  # fmt: skip


def _mode_sets(name: str, modes: Modes, nodes: Nodes) -> Iterable[dict[str, Any]]:
    """Yield mode shapes along x, y and z of the nodes; rotations and outputs without a direction are omitted."""
    translating = [(i, *nodes[place]) for i, place in enumerate(modes.places) if 1 <= abs(nodes[place][1]) <= 3]
    numbers = sorted({node for _, node, _ in translating})
    for r in range(modes.n_modes if numbers else 0):
        shape = np.zeros((3, len(numbers)), complex)
        for i, node, direction in translating:
            shape[abs(direction) - 1, numbers.index(node)] = np.sign(direction) * modes.place_shapes[0][i, r]
        yield {
            "type": 55, "id1": uff_text(name), "id4": uff_text(modes.configuration),
            "id5": uff_text(f"{modes.freq_hz[r]:.6g} Hz, damping ratio {modes.zeta[r]:.5g}"),
            "model_type": _STRUCTURAL, "analysis_type": _COMPLEX_MODES, "data_ch": _TRANSLATIONS,
            "spec_data_type": _ORDINATES["position"], "data_type": 5, "n_data_per_node": 3, "load_case": 1,
            "mode_n": r + 1, "eig": complex(modes.poles[r]), "node_nums": numbers,
            **{f"r{axis + 1}": shape[axis] for axis in range(3)},
        }  # fmt: skip


TARGETS = (
    Target(
        "uff", ("name", "responses", "modes", "geometry"), "measured FRFs and modes in universal files", write_uff, True
    ),
)
