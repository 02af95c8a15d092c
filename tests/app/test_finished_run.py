"""elastid.run: a study from Python, its results as values, and what is done with them."""

import numpy as np
import pytest
from plants.refusals import refused

import elastid
from elastid.app.cli import run_command
from elastid.app.finished_run import FinishedRun
from elastid.base.errors import UnknownNameError

pytestmark = pytest.mark.slow  # whole runs
KEYS = ["report.formats=[]", "compare={variants: [{name: undamped, set: [fit.parameters.d_1.fixed=true]}]}"]


@pytest.fixture(scope="module")
def done(tmp_path_factory) -> FinishedRun:
    folder = tmp_path_factory.mktemp("run") / "bench"
    assert run_command(["new", str(folder), "--template", "recorded"]) == 0
    return elastid.run(folder / "study.yml", folder / "run", set=KEYS, verbosity=-2)


def test_a_run_gives_its_values(done: FinishedRun) -> None:
    low, high = done.result["k_1"].interval
    assert low < 64.0 < high  # the truth of the template's logs
    response = done.responses["bench"]
    assert response["joint 1", "motor 1"].G.shape == (response.n_lines, 1, 1)
    assert np.all(response.coherence <= 1.0)
    assert "fit.h5" in repr(done)
    with refused("export/target"):
        elastid.export(done, "matlb")
    assert {row.name for row in elastid.compare(done).rows} == {"recorded", "undamped"}


def test_other_numbers_are_those_of_another_robot(done: FinishedRun) -> None:
    """The modes of a result with another spring are those of two inertias with it, motor free."""
    result = done.result
    other = result.with_parameters(k_1=50.0, fm_1=1e-9, d_1=1e-9)
    values = other.values
    inertia = values["Jm_1"] * result.robot.driven[0].motor.ratio ** 2
    load = values["I_load"]
    free = other.at([0.0], motors="free", inputs=["motor 1"], outputs=["motor 1"]).modes()
    omega = np.sqrt(50.0 * (1 / inertia + 1 / load))
    np.testing.assert_allclose(free.freq_hz[-1], omega / (2 * np.pi), rtol=1e-9)
    assert other.std["k_1"] == 0.0
    assert other.std["I_load"] == result.std["I_load"]
    assert "by hand: k_1 = 50" in other.message
    for wrong in ({"k_1": "1e5"}, {"k_1": None}):
        with pytest.raises(TypeError):
            result.with_parameters(**wrong)
    with pytest.raises(UnknownNameError, match="no parameter k_9"):
        result.with_parameters(k_9=1.0)
    with pytest.raises(ValueError, match="k_1 = -1: give a finite positive number in N"):
        result.with_parameters(k_1=-1.0)
