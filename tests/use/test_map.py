"""Maps: quantities against one posture at a time, slopes, order, limiting springs, intervals, postures without rest."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from plants.arm import result, robot
from plants.fitted_models import fitted_model
from plants.refusals import refused

from elastid.base.propagation import propagate
from elastid.fit.parameter_selection import choose, with_tolerances
from elastid.fit.posture import PredictionPorts
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.response.transfer import frequency_response
from elastid.model.spec import ModelSpec
from elastid.report.command_summaries import answer_of_map
from elastid.robot import Frame, Tolerances
from elastid.use import map as map_module
from elastid.use.locked_postures import LockedEquations
from elastid.use.map import map_workspace
from elastid.use.posture_values import Cut

LINES = np.geomspace(2.0, 80.0, 100)
CUT = Cut(load=(0.0, 0.0, -50.0), normal=(1.0, 0.0, 1.0))


@pytest.mark.parametrize("name", ["arm", "scara", "linkage_arm minimal", "linkage_arm constrained"])
def test_a_map_has_the_numbers_of_each_posture_by_itself(name: str) -> None:
    """Serial robots and linkages; values and deviations."""
    if name == "arm":
        own = result()
    else:
        fitted = fitted_model(name)
        spec = ModelSpec("minimal") if "minimal" in name else ModelSpec()
        own = replace(fitted.result, robot=fitted.model.robot, equations=spec)
    angles = np.atleast_2d(own.robot.joints[0].start + 0.1 * np.arange(6).reshape(2, 3))[:, : len(own.robot.driven)]
    workspace = map_workspace(own, angles, CUT, lines_hz=LINES)
    for i, each in enumerate(workspace.angles):
        model = own.at(each, axes="world")
        stiff, modes = model.stiffness(), model.modes()
        principal, directions = stiff.principal
        assert workspace["softest_compliance"].value[i] == pytest.approx(principal[0], rel=1e-8)
        assert abs(workspace.axes[i, :, 0] @ directions[:, 0]) == pytest.approx(1, abs=1e-6)
        assert workspace["compliance_x"].std[i] == pytest.approx(stiff.compliance_std[0, 0], rel=1e-2)
        assert workspace["deflection"].value[i] == pytest.approx(np.linalg.norm(stiff.compliance[:3, 2] * 50), rel=1e-8)
        assert workspace["frequency_1"].value[i] == pytest.approx(modes.freq_hz[0], rel=1e-8)
        assert workspace["frequency_1"].std[i] == pytest.approx(modes.freq_std[0], rel=1e-2)
        assert workspace.compliance_fraction[i].sum() == pytest.approx(1, abs=0.03)  # the rest is gravity's
    assert np.all(np.diff(workspace["softest_compliance"].value[workspace.softest]) <= 0)


def test_extremes_of_the_response_are_found_between_the_lines() -> None:
    """A coarse grid gives the peak, the depth of cut and their deviations to those of a fine one."""
    angles = np.array([[0.2, 0.9]])
    workspace = map_workspace(result(), angles, CUT, lines_hz=LINES)
    model = result().at(angles[0], axes="world")
    fine = np.linspace(2, 80, 20001)
    G = model.response(fine).G
    assert workspace["dynamic_compliance"].value[0] == pytest.approx(
        np.linalg.svd(G, compute_uv=False)[:, 0].max(), rel=1e-3
    )
    n, softest = np.array([1.0, 0.0, 1.0]) / np.sqrt(2), workspace.axes[0, :, 0]
    near, curve = workspace.chatter_hz + np.linspace(-0.5, 0.5, 501), workspace.curve_hz[::20]
    expected = {
        "depth_of_cut": (near, lambda G: -1 / (2 * 700e6 * (n @ G @ n).real.min())),
        "deflection": (1e-3, lambda G: np.linalg.norm(G[0].real @ CUT.load)),
        "magnitude": (curve, lambda G: np.abs(softest @ G @ softest)),
    }
    known = {name: (workspace[name].value[0], workspace[name].std[0]) for name in ("depth_of_cut", "deflection")}
    known["magnitude"] = workspace.magnitude[0, ::20], workspace.magnitude_std[0, ::20]
    for name, (lines, quantity) in expected.items():
        spread = propagate(
            lambda x, lines=lines, quantity=quantity: np.asarray(
                quantity(frequency_response(model.linear, model.estimated.theta(x), lines))
            ),
            model.estimated.x,
            model.estimated.covariance / 1e4,
        )
        np.testing.assert_allclose(known[name][0], spread.value, rtol=1e-5)
        np.testing.assert_allclose(known[name][1] / 100, spread.std, rtol=0.02)


@pytest.mark.parametrize("name", ["manutec", "linkage_arm constrained"])
def test_robot_tolerances_widen_map_as_postures(name: str) -> None:
    """Masses, centres, lengths and zeros of axes within their tolerances; lengths of a loop move its joints."""
    fitted = fitted_model(name)
    robot = replace(fitted.model.robot, tolerances=Tolerances())
    spec = FitSpec(parameters={"k_*": ParameterSpec()})
    parameters = with_tolerances(choose(spec, robot), robot, spec)
    n = len(parameters.free)
    C = np.diag([1e-4 if p.prior is None else p.prior.std**2 for p in parameters.free]) / 9
    ended = (1.0, 1, 1.0, "converged", "", (), 1, np.zeros(n, bool), np.ones(n), "complex")
    own = Result(parameters, parameters.x, C, *ended, robot=robot)
    workspace = map_workspace(own, fitted.linear[0].configuration.angles[None], CUT, lines_hz=LINES)
    model = own.at(fitted.linear[0].configuration.angles, axes="world")
    assert workspace["compliance_z"].std[0] == pytest.approx(model.stiffness().compliance_std[2, 2], rel=0.05)
    assert workspace["frequency_1"].std[0] == pytest.approx(model.modes().freq_std[0], rel=0.05)
    equations = LockedEquations(own.family(PredictionPorts(axes="world")))
    q = equations.rest(workspace.angles)[0]
    at, one = equations.at(workspace.angles, q), equations._linearised(workspace.angles[0], q[0])
    for slopes, expected in zip((at.triangles[0], at.J_slopes[0]), one[4:6], strict=True):
        np.testing.assert_allclose(slopes, expected, rtol=1e-6, atol=1e-9 * np.abs(expected).max())


def test_map_in_pieces_keeps_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Springs far too soft for the weight stretched out; hanging down the robot rests. Columns in files, one sample."""
    own = result()
    place = [own.parameters.free_names.index(name) for name in ("k_1", "k_2")]
    x = own.x.copy()
    x[place] = np.log([150.0, 60.0])
    angles = np.vstack([[[-np.pi / 2, 0], [np.pi / 2, 0]], np.random.default_rng(0).uniform(-3, 3, (120, 2))])
    assert map_workspace(replace(own, x=x), angles[:2], lines_hz=LINES).refused.tolist() == [0]
    whole = map_workspace(replace(own, x=x), angles, lines_hz=LINES)
    monkeypatch.setattr(map_module, "SAMPLE", 12)
    pieces = map_workspace(replace(own, x=x), angles, lines_hz=LINES)
    np.testing.assert_array_equal(pieces.asked, whole.asked)
    np.testing.assert_allclose(pieces["depth_of_cut"].value, whole["depth_of_cut"].value, rtol=1e-9)
    sample, softest = pieces.sample, pieces.softest
    assert len(sample) <= 12 + 11
    assert {*pieces.asked[softest[:10]], pieces.asked[softest[-1]]} <= {*sample.asked}


@pytest.mark.parametrize(
    "wrong", [{"normal": (0, 0, 0)}, {"force": (0, 0, 1)}, {"load": (np.nan, 0, 0)}, {"cutting_coefficient": 0.0}]
)
def test_a_cut_without_direction_size_or_coefficient_is_none(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"load|coefficient|force"):
        Cut(**wrong)


def test_motionless_frame_has_frequencies_and_no_direction() -> None:
    hub = replace(robot(), frames=(Frame("hub", "upper"),))
    mapped = map_workspace(replace(result(), robot=hub), np.array([[0.2, 0.9], [-0.2, 0.1]]))
    assert np.all(mapped["frequency_1"].value > 1)
    ((_, (text,)),) = answer_of_map(mapped).questions
    assert "hub" in text


def test_where_nothing_rests_the_map_says_why() -> None:
    """A robot of rubber."""
    own = result()
    rubber = replace(own, x=own.x - np.log(4e4))
    with refused("robot/no-equilibrium", holds="1 postures"):
        map_workspace(rubber, np.array([[-0.2, 0.1]]))
