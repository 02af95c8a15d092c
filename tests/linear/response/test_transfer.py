"""The linear model of an elastic arm and of two masses: modes, and images of held torques."""

from dataclasses import replace

import numpy as np
import pytest
from plants.template_arm import arm, linear
from scipy.linalg import expm
from scipy.signal import cont2discrete

from elastid.linear.linear_model import LinearModel, Slope
from elastid.linear.modes import modes
from elastid.linear.response.transfer import frequency_response
from elastid.parameters import DELAY
from elastid.record import Configuration, ZohTorque


def test_modes_are_where_the_dynamic_stiffness_is_singular():
    """(lambda^2 M + lambda D + K) phi = 0 for every mode found, with friction and gravity."""
    model = linear(arm())
    found = modes(model, model.theta_ref)
    assert found.freq_hz.size * 2 + found.real_poles.size == 2 * model.n
    for f, zeta, phi in zip(found.freq_hz, found.zeta, found.shapes.T, strict=True):
        pole = 2 * np.pi * f * (-zeta + 1j * np.sqrt(1 - zeta**2))
        left = (pole**2 * model.M + pole * model.D + model.K) @ phi
        assert np.abs(left).max() < 1e-7 * np.abs(model.K @ phi).max()


RATE_HZ = 500.0
E = np.array([[1.0, -1.0], [-1.0, 1.0]])


def two_masses(resonance_hz: float, delay: float = 0.0) -> LinearModel:
    """Motor of 6 kg m^2 with friction, load of 10 kg m^2, a spring with 3 % damping between them; motor and load."""
    omega = 2 * np.pi * resonance_hz
    k, d, f = 3.75 * omega**2, 0.06 * 3.75 * omega, 8.0
    rotor = np.diag([1.0, 0.0])
    return LinearModel(
        configuration=Configuration("a", np.zeros(1)),
        parameters=("k", "d", "fm", "Jm", DELAY, "torque_lag", "sensor_lag"),
        theta_ref=np.array([k, d, f, 6.0, delay, 2e-4, 1e-4]),
        M=np.diag([6.0, 10.0]),
        D=d * E + f * rotor,
        K=k * E,
        slopes={"k": Slope(K=E), "d": Slope(D=E), "fm": Slope(D=rotor), "Jm": Slope(M=rotor)},
        B=np.array([[1.0], [0.0]]),
        C=np.eye(2),
        inputs=("motor 1",),
        outputs=("motor 1", "load"),
        quantity="acceleration",
        hold=ZohTorque((RATE_HZ,), (True, True)),
    )


def discretised(model: LinearModel, freq_hz: np.ndarray, delay: float) -> np.ndarray:
    """(j omega)^2 Y / (H U) (F, n_y, 1), held torque and sampled angle, the torque late by less than a sample."""
    n, T = 4, 1 / RATE_HZ
    zero = np.zeros((2, 2))
    A = np.block([[zero, np.eye(2)], [-np.linalg.solve(model.M, model.K), -np.linalg.solve(model.M, model.D)]])
    B, C = np.vstack([np.zeros((2, 1)), np.linalg.solve(model.M, model.B)]), np.hstack([model.C, zero])
    Ad, B_now, *_ = cont2discrete((A, B, C, np.zeros((2, 1))), T - delay)
    late = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) * delay)
    step, B_before = Ad @ late[:n, :n], Ad @ late[:n, n:]
    z = np.exp(2j * np.pi * freq_hz * T)[:, None, None]
    hold = (np.exp(-1j * np.pi * freq_hz * T) * np.sinc(freq_hz * T))[:, None, None]
    return (
        C
        @ np.linalg.solve(z * np.eye(n) - step, B_now + B_before / z)
        * (2j * np.pi * freq_hz[:, None, None]) ** 2
        / hold
    )


@pytest.mark.parametrize("delay", [0.0, 7e-4])
@pytest.mark.parametrize(
    ("resonance_hz", "edge_hz", "tolerance"), [(25, 60, 1e-8), (25, 225, 1e-6), (50, 225, 1e-6), (200, 60, 3e-7)]
)
def test_images_give_response_of_held_sampled_plant(
    resonance_hz: float, edge_hz: float, tolerance: float, delay: float
) -> None:
    """To 1e-8 of the largest G of an output at an eighth of the rate, 1e-6 at 0.45, where images alone are 100 %."""
    model, freq_hz = two_masses(resonance_hz, delay), np.linspace(1, edge_hz, 80)
    exact = discretised(model, freq_hz, delay)
    G = frequency_response(model, model.theta_ref, freq_hz)
    scale = np.abs(exact).max(axis=0)
    assert np.max(np.abs(G - exact) / scale) < tolerance
    without = frequency_response(replace(model, hold=None), model.theta_ref, freq_hz)
    assert np.max(np.abs(without - exact) / scale) > 1e-5
