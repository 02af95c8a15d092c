"""Normal equations on few columns and on half of a symmetric response: the same numbers as from all elements."""

from dataclasses import replace

import numpy as np
import pytest
from plants.elastic_arm import arm
from plants.three_mass import FREQ, circular

from elastid.base.kernels import is_compiled
from elastid.fit.setup.assembly import Assembly
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.spec import FactorSpec, FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration, HeldTorque
from elastid.response import Covariance
from elastid.robot import Body, Chain, Frame, Joint, Motor, Placement, Robot, Spring

NAMES = ("k_*", "d_*", "fm_*", "Jm_*", "m_fore", "c_fore_x", "delay", "torque_lag", "sensor_lag")
TOOL = Frame("tool", "fore", Placement((0.9, 0.0, 0.1), (0.0, 0.3, 0.0)))
needs_compiler = pytest.mark.skipif(not is_compiled(), reason="the kernels in C are not built")


@pytest.fixture(params=[False, pytest.param(True, marks=needs_compiler)], ids=["NumPy", "compiled"])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops that are compiled, however few lines there are, and none."""
    monkeypatch.setattr("elastid.linear.response.kernel.is_compiled", lambda: request.param)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("rate_hz", [0.0, 200.0])
@pytest.mark.parametrize("covariance", ["diagonal", "full"])
@pytest.mark.parametrize("criterion", ["complex", "log"])
@pytest.mark.parametrize(
    "outputs",
    [
        ("motor 1", "motor 2"),
        ("motor 2", "motor 1"),
        ("motor 1", "joint 2", "motor 2"),
        ("motor 1", "accelerometer tool x"),
    ],
)
def test_cost_gradient_and_normal_matrix_are_those_of_the_stacked_residuals(covariance, criterion, outputs, rate_hz):
    """Springs with dampers, rotors with friction, a mass under gravity, a centre of mass, the delay and lags.

    Symmetric responses, outputs in another order, not collocated or an accelerometer that tilts; a mask that
    leaves one of a pair of mirrored elements. Torques held at rate_hz, lines up to a fifth of it: the normal matrix
    without the slopes of their images, the gradient with them.
    """
    robot, rng = replace(arm(), chain=Chain(torque_lag=2e-4, sensor_lag=1e-4), frames=(TOOL,)), np.random.default_rng(0)
    model = serial(robot)
    linear = Linearisation.of(model).at(Configuration("c1", (0.3, -0.5)), model.theta, outputs, "acceleration")
    held = HeldTorque((rate_hz,) * 2, tuple(place != "accelerometer tool x" for place in outputs))
    linear = replace(linear, hold=held if rate_hz else None)
    exact = to_response(linear, np.append(model.theta, 1e-4), FREQ[::2])
    F, n_y, n_u = exact.G.shape
    std = 0.02 * np.abs(exact.G) + 1e-4 * np.abs(exact.G).max(axis=0)
    root = circular(rng, (F, n_y * n_u, 2 * n_y * n_u)) * std.transpose(0, 2, 1).reshape(F, -1, 1)
    C = root @ root.conj().transpose(0, 2, 1) / root.shape[2]
    known = Covariance(np.einsum("faa->fa", C).real.reshape(F, n_u, n_y).transpose(0, 2, 1), np.inf, matrix=C)
    response = replace(exact, G=exact.G + std * circular(rng, std.shape), noise=known)
    spec = FitSpec(
        criterion=criterion,
        parameters={name: ParameterSpec() for name in NAMES},
        weights=WeightSpec(
            covariance=covariance,
            factors=(
                FactorSpec(0.0, output="motor 1", input="motor 2", band_hz=(8.0, 15.0)),
                FactorSpec(0.0, band_hz=(20.0, 20.5)),
            ),
        ),
    )
    parameters = choose(spec, robot)
    fit = Assembly.of([response], robot, spec, parameters).at(parameters.x, criterion)
    x = parameters.x + 0.02 * rng.standard_normal(len(parameters.x)) * (parameters.x > 0)
    here, (r, J) = fit.evaluate(x), fit.residual(x)
    scale = 2 * np.linalg.norm(J, axis=0)
    assert here.cost == pytest.approx(r @ r, rel=1e-10)
    np.testing.assert_allclose(here.gradient / scale, 2 * J.T @ r / scale, atol=1e-9 * np.linalg.norm(r))
    tolerance = 0.005 if rate_hz else 1e-12
    expected = 2 * J.T @ J / np.outer(scale, scale)
    np.testing.assert_allclose(here.hessian / np.outer(scale, scale), expected, atol=tolerance)
    assert fit.parts[0].normal.columns.is_symmetric == (outputs == ("motor 1", "motor 2"))


@pytest.mark.usefixtures("loops")
def test_a_mass_without_gravity_acts_along_three_directions():
    """However many joints carry it: derivatives along these three are those of every element."""
    bodies = [
        Body(
            f"{i}",
            f"{i - 1}" if i else "base",
            Placement((0.3, 0.0, 0.1)),
            (Joint(f"{i}", "zyxzyxz"[i], Spring(1e4 / (i + 1), 10.0), Motor(1e-3, 100.0, 1e-3)),),
            mass=5.0,
            center_of_mass=(0.1, 0.05, 0.1),
            inertia=0.1,
        )
        for i in range(7)
    ]
    robot, rng = Robot("chain", tuple(bodies), (0.0, 0.0, 0.0)), np.random.default_rng(1)
    model = serial(robot)
    places = tuple(f"motor {i}" for i in range(7))
    linear = Linearisation.of(model).at(
        Configuration("c1", tuple(rng.uniform(-1, 1, 7))), model.theta, places, "velocity"
    )
    exact = to_response(linear, np.append(model.theta, 0.0), FREQ[::4])
    std = 0.02 * np.abs(exact.G) + 1e-4 * np.abs(exact.G).max(axis=0)
    response = replace(exact, G=exact.G + std * circular(rng, std.shape), noise=Covariance(std**2, np.inf))
    spec = FitSpec(parameters={name: ParameterSpec() for name in ("m_6", "k_*")})
    parameters = choose(spec, robot)
    fit = Assembly.of([response], robot, spec, parameters).at(parameters.x, "complex")
    x = parameters.x + 0.02 * rng.standard_normal(len(parameters.x))
    here, (r, J) = fit.evaluate(x), fit.residual(x)
    scale = 2 * np.linalg.norm(J, axis=0)
    np.testing.assert_allclose(here.gradient / scale, 2 * J.T @ r / scale, atol=1e-9 * np.linalg.norm(r))
    expected = 2 * J.T @ J / np.outer(scale, scale)
    np.testing.assert_allclose(here.hessian / np.outer(scale, scale), expected, atol=1e-12)
    part = next(fit.parts[0].normal.columns.at(fit.theta(fit.parts[0], x)))
    assert part.S.shape == (2, 1, 3, 3)
