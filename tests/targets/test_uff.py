"""Universal files hold responses and modes, as pyuff reads them back."""

from pathlib import Path

import numpy as np
import pytest

from elastid.experiment.specs.channels import ChannelSpec
from elastid.logs.responses.universal_files import uff_geometry, uff_table
from elastid.modal.estimate import estimate_modes
from elastid.modal.spec import GeometrySpec
from elastid.record import Configuration
from elastid.response import Response
from elastid.targets.uff import write_uff


@pytest.mark.parametrize("outputs", [("1x", "1z", "2x"), ("tip x", "tip z", "foot x")], ids=("numbers", "names"))
def test_modes_are_read_back(tmp_path: Path, outputs: tuple[str, ...]) -> None:
    """Two modes seen along x and z of two nodes: eigenvalues and shapes to the five digits of a data set 55."""
    pyuff = pytest.importorskip("pyuff")
    freq_hz = np.arange(20, 400) / 8
    omega, natural, zeta = 2 * np.pi * freq_hz[:, None], 2 * np.pi * np.array([11.0, 27.0]), np.array([0.01, 0.02])
    shapes = np.array([[1.0, 0.5], [0.4, -1.0], [0.2, 0.3]])
    modal = 1 / (natural**2 - omega**2 + 2j * zeta * natural * omega)
    G = np.einsum("ir,fr,r->fi", shapes, modal, shapes[0])[:, :, None]
    bench = Configuration("bench", np.zeros(0))
    response = Response(freq_hz, G, ("shaker",), outputs, "position", bench)
    path = write_uff(tmp_path, "study", [response], [estimate_modes(response)])[0]
    written = pyuff.UFF(str(path)).read_sets()
    assert {each["orddenom_spec_data_type"] for each in written if each["type"] == 58} == {13}  # a force
    sets = [each for each in written if each["type"] == 55]
    poles = natural * (1j * np.sqrt(1 - zeta**2) - zeta)
    np.testing.assert_allclose([each["eig"] for each in sets], poles, rtol=1e-4)
    for each, shape in zip(sets, (shapes / np.abs(shapes).max(axis=0)).T, strict=True):
        expected = shape / np.sign(shape[np.abs(shape).argmax()])
        np.testing.assert_allclose(each["r1"], [expected[0], expected[2]], atol=1e-4)
        np.testing.assert_allclose(each["r3"], [expected[1], 0], atol=1e-4)


def test_geometry_and_roving_hammer_are_read_back(tmp_path: Path) -> None:
    """Two points that a hammer hits, one against z, and a corner without any: nodes, lines, signs and shapes."""
    pyuff = pytest.importorskip("pyuff")
    points = {"1": (0.0, 0.0, 0.0), "2": (0.5, 0.0, 0.0), "corner": (0.5, 0.25, 0.0)}
    geometry = GeometrySpec(points=points, lines=(("1", "2"), ("2", "corner")), motion={"hit 2": ("2", "-z")})
    freq_hz = np.arange(20, 400) / 8
    omega, natural = 2 * np.pi * freq_hz, 2 * np.pi * 20.0
    shape = np.array([1.0, -0.5])
    G = (1 / (natural**2 - omega**2 + 0.02j * natural * omega))[:, None, None] * shape
    bench = Configuration("bench", np.zeros(0))
    response = Response(freq_hz, G, ("1 z", "hit 2"), ("1 z",), "position", bench)
    path = write_uff(tmp_path, "study", [response], [estimate_modes(response)], geometry)[0]
    hammer = ChannelSpec("u", "hit 2", channel="2z", quantity="force", sign=-1)
    places = (hammer, ChannelSpec("y", "1 z", channel="1z", quantity="position"))
    found = uff_geometry(path, places)
    assert [found.points[node] for node in "123"] == list(points.values())
    assert found.lines == (("1", "2"), ("2", "3"))
    assert found.motion == {"hit 2": ("2", "-z"), "1 z": ("1", "z")}
    np.testing.assert_allclose(uff_table(path, ()).G[:, 0], G[:, 0] * [1, -1], rtol=1e-5)
    (modes,) = [each for each in pyuff.UFF(str(path)).read_sets() if each["type"] == 55]
    np.testing.assert_allclose(modes["r3"], [1, 0.5], atol=1e-4)
