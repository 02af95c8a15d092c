"""Universal files: their units and their geometry are believed."""

from pathlib import Path

import numpy as np
import pytest

from elastid.experiment.specs.channels import ChannelSpec
from elastid.recorded.responses.table import uff_geometry, uff_places, uff_table

pyuff = pytest.importorskip("pyuff")
FREQ_HZ = np.arange(1.0, 40.0)
G = 1 / (400 - FREQ_HZ**2 + 8j * FREQ_HZ)


def written(path: Path, units: int) -> Path:
    """One response of node 2 along z to node 1, three nodes 100 of their units apart, two trace lines."""
    nodes = {"node_nums": [1, 2, 3], "def_cs": [0] * 3, "disp_cs": [0] * 3, "color": [0] * 3}
    coordinates = {"x": [0.0, 100.0, 200.0], "y": [0.0] * 3, "z": [0.0, 0.0, 50.0]}
    places = {"rsp_node": 2, "rsp_dir": -3, "ref_node": 1, "ref_dir": 3}
    sets = [
        {"type": 164, "units_code": units, "units_description": "own", "temp_mode": 1, "length": 1e3, "force": 1e3,
         "temp": 1.0, "temp_offset": 273.15},
        {"type": 15, **nodes, **coordinates},
        {"type": 82, "trace_num": 1, "n_nodes": 4, "color": 1, "id": "edge", "nodes": np.array([1, 2, 0, 3])},
        {"type": 82, "trace_num": 2, "n_nodes": 2, "color": 1, "id": "edge", "nodes": np.array([2, 3])},
        {"type": 58, "binary": 0, "func_type": 4, "id1": "a", "id2": "b", "id3": "c", "id4": "d", "id5": "e", **places,
         "rsp_ent_name": "NONE", "ref_ent_name": "NONE", "abscissa_spec_data_type": 18, "ordinate_spec_data_type": 12,
         "orddenom_spec_data_type": 13, "ord_data_type": 6, "abscissa_spacing": 0, "abscissa_min": 1.0,
         "abscissa_inc": 0.0, "data": G, "x": FREQ_HZ},
    ]  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, "overwrite")
    return path


def channels(unit: str) -> tuple[ChannelSpec, ...]:
    return (
        ChannelSpec("u", "hammer", channel="1z", quantity="force", unit="N"),
        ChannelSpec("y", "tip", channel="2z", quantity="acceleration", unit=unit, sign=-1),
    )


@pytest.mark.parametrize(
    ("code", "metre", "newton"), [(1, 1, 1), (5, 1e-3, 1e-3), (7, 0.0254, 4.4482216), (9, 1e-3, 1e-3)]
)
def test_units_of_a_file_are_believed(tmp_path: Path, code: int, metre: float, newton: float) -> None:
    """Metres, millimetres with millinewton, inches with pounds, and factors of the file's own."""
    table = uff_table(written(tmp_path / "a.uff", code), channels("m/s^2"))
    np.testing.assert_allclose(table.G[:, 0, 0], -G * metre / newton, rtol=1e-6)
    assert [note.code for note in table.notes] == ([] if code == 1 else ["responses/units"])


def test_a_unit_of_the_study_overrides_that_of_the_file(tmp_path: Path) -> None:
    """mm/s^2 in both is not taken twice: the channel's own factor comes later."""
    table = uff_table(written(tmp_path / "a.uff", 10), channels("mm/s^2"))
    np.testing.assert_allclose(table.G[:, 0, 0], -G, rtol=1e-6)


def test_geometry_is_that_of_nodes_and_trace_lines(tmp_path: Path) -> None:
    """Millimetres in m; a trace line is interrupted at 0; a place with the other sign moves the other way."""
    geometry = uff_geometry(written(tmp_path / "a.uff", 10), channels("m/s^2"))
    assert geometry is not None
    np.testing.assert_allclose([geometry.points[name] for name in "123"], [[0, 0, 0], [0.1, 0, 0], [0.2, 0, 0.05]])
    assert geometry.lines == (("1", "2"), ("2", "3"))
    assert geometry.motion == {"hammer": ("1", "z"), "tip": ("2", "-z")}
    other = (ChannelSpec("y", "tip", channel="9z", quantity="acceleration"),)
    assert uff_geometry(tmp_path / "a.uff", other) is None


def test_places_are_those_of_the_responses(tmp_path: Path) -> None:
    """Node 2 along z answers node 1: the channels of a study that `new --from` writes."""
    assert uff_places(written(tmp_path / "a.uff", 1)) == ({"2z": "acceleration"}, ("1z",))
