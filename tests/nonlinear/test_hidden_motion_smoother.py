"""Shapes of gear effects and the hidden motion against closed forms, and the covariance of what it leaves."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from plants.two_mass_gear import POSTURE, RATE_HZ, SAMPLES, Gear, robot

from elastid.base.arrays import FloatArray
from elastid.fit.parameter_selection import choose
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linearise import Linearisation
from elastid.nonlinear.basis_functions import GearEffect, GearMotion, along_period, forces, sign_of, transmission_error
from elastid.nonlinear.hidden_motion_smoother import smoothed_covariance
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import DriveLines, drive_lines, elastic_joints
from elastid.nonlinear.periodic_newton import newton
from elastid.response import Response


@pytest.mark.parametrize(("h", "start"), [(1.0, 0.0), (50.0, 0.0), (50.0, 100.0)])
def test_a_hardening_spring_at_rest_is_cardanos(h: float, start: float) -> None:
    """x + h x^3 = x_0, point by point, where forces move the deflection by themselves alone.

    Eight steps of Newton's method would not leave a start at 100 times the motion.
    """
    x_0 = np.linspace(-1, 1, 101)[None]
    x = newton(lambda x: (h * x**3, 3 * h * x**2), lambda force: force, x_0, start * x_0)[0]
    root = np.sqrt(x_0**2 / (4 * h**2) + 1 / (27 * h**3))
    exact = np.cbrt(x_0 / (2 * h) + root) + np.cbrt(x_0 / (2 * h) - root)
    assert x == pytest.approx(exact, abs=1e-4)


def test_coulomb_friction_that_turns_gradually_sticks_and_slides() -> None:
    """w + F tanh(w / w_s) = w_0: nearly at rest within F, slower by F beyond it."""
    w_0 = np.linspace(-3, 3, 61)[None]

    def law(w: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.tanh(w / 0.2), (1 - np.tanh(w / 0.2) ** 2) / 0.2

    w = newton(law, lambda force: force, w_0, w_0)[0]
    assert w + np.tanh(w / 0.2) == pytest.approx(w_0, abs=1e-3)
    fast = np.abs(w_0) > 1.8
    assert w[fast] == pytest.approx((w_0 - np.sign(w_0))[fast], abs=2e-3)


def test_residual_covariance_follows_narrow_resonance() -> None:
    """Noise of torque through a mode of three lines' width, and of angles: within 20 % at the peak and beside it."""
    none, rest, rng = np.zeros((100, 1, 400), complex), np.zeros((1, 400)), np.random.default_rng(1)
    numbers = np.array([1e-16]), np.zeros((100, 1)), np.ones(100, bool), np.arange(400)
    lines = PeriodLines(POSTURE, 500.0, 100, none + 1, none, rest, rest, *numbers, rest[:, 0], np.ones(1, bool))
    omega = lines.s.imag / lines.s.imag[29]
    G = 1e-6 / (1 - omega**2 + 0.05j * omega)[:, None, None]
    normal = rng.standard_normal((4, 100, 1, 400)) / np.sqrt(2)
    r = 0.03 * G * (normal[0] + 1j * normal[1]) + 1e-8 * (normal[2] + 1j * normal[3])
    S = smoothed_covariance(r, lines, cast(DriveLines, SimpleNamespace(G=G)))
    assert S.real.ravel() == pytest.approx(9e-4 * np.abs(G.ravel()) ** 2 + 1e-16, rel=0.2)


PHASE = 2 * np.pi * np.arange(800) / 800


@pytest.mark.parametrize("scale", [0.0, 1e-3])
def test_reversals_between_points_turn_where_the_motion_is_bent(scale: float) -> None:
    """A velocity of 0.4 of its slope on one side of 0, against the law on 200 times as many points."""

    def bent(phase: FloatArray) -> FloatArray:
        return 0.1 * np.where(np.sin(phase) > 0, 1.0, 0.4) * np.sin(phase)

    dense = (np.arange(160_000) + 0.5) * np.pi / 80_000
    exact = np.mean((np.tanh(bent(dense) / scale) if scale else np.sign(bent(dense))) * np.exp(-1j * dense))
    for shift in np.linspace(0.0, 2 * np.pi / 800, 7):
        phi, slope = sign_of(bent(PHASE - shift), scale)
        assert np.mean(phi * np.exp(-1j * (PHASE - shift))) == pytest.approx(exact, abs=3e-4)
        assert np.all(slope >= 0)


def test_a_motion_that_stands_still_has_numbers() -> None:
    """Nothing moves, or it turns and then stands: no division by a step that is none."""
    still = np.zeros(100)
    stands = np.concatenate([np.full(30, -1.0), [-0.5, 0.5], np.zeros(68)])
    for v in (still, stands):
        phi, slope = sign_of(v, 0.1)
        assert np.all(np.isfinite(phi))
        assert np.all(np.isfinite(slope))
    assert np.all(sign_of(still, 0.1)[0] == 0)


GEAR = Gear()


def test_motor_gear_link_forces_move_two_masses() -> None:
    start = robot(GEAR)
    linearisation = Linearisation.of_robot(start)
    parameters = choose(FitSpec(parameters={"k_*": ParameterSpec()}), start, ["rest"])
    F, none = 100, np.zeros((100, 1, 1), complex)
    lines = PeriodLines(
        POSTURE, RATE_HZ, SAMPLES, none, none, *np.zeros((2, 1, 1)), np.ones(1), np.ones((F, 1)), np.ones(F, bool),
        np.zeros(1, np.int64), np.zeros(1), np.ones(1, bool),
    )  # fmt: skip
    places = ("motor 1",)
    response = Response(lines.freq_hz, none, places, places, "acceleration", POSTURE)
    drive = drive_lines(lines, linearisation, response, parameters, parameters.x)
    s, g = lines.s, GEAR
    motor, link, spring = g.J_m * s**2 + g.f * s, g.J_l * s**2, g.k + g.d * s
    det = (motor + spring) * (link + spring) - spring**2
    by_place = {"motor": (link + spring) / det, "gear": link / det, "link": spring / det}
    assert elastic_joints(linearisation) == ("1",)
    for place, exact in by_place.items():
        assert (drive.C @ drive.H @ drive.directions(place, 0))[:, 0] == pytest.approx(exact, rel=1e-9)
    assert drive.G[:, 0, 0] == pytest.approx(by_place["motor"], rel=1e-9)
    assert np.abs(drive.aliases).max() < 1e-9 * np.abs(drive.G).max()
    assert (drive.k[0], drive.d[0], drive.torque[0]) == pytest.approx((g.k, g.d, 0.0))


MOTION = GearMotion(
    angle=0.02 * np.sin(PHASE), velocity=0.1 * np.cos(PHASE), link_velocity=0.1 * np.cos(PHASE - 0.1),
    deflection=1e-3 * np.sin(PHASE + 0.3), torque=200 * np.sin(PHASE + 0.3), ratio=100.0, k=2e5, d=60.0,
)  # fmt: skip


@pytest.mark.parametrize("kind", ["cubic", "progressive", "range", "gap"])
def test_slopes_are_those_of_the_law(kind: str) -> None:
    effect, x, h = GearEffect(kind, "1", 0.02), 0.03 * np.sin(PHASE), 1e-7
    difference = (along_period(effect, x + h)[0] - along_period(effect, x - h)[0]) / (2 * h)
    assert along_period(effect, x)[1] == pytest.approx(difference, rel=1e-6, abs=1e-6)


def test_smoothing_scale_derivative_equals_difference() -> None:
    for kind, scale in (("behind", 0.02), ("load", 0.02), ("stop", 3e-4), ("gap", 3e-4)):
        effect = GearEffect(kind, "1", scale)
        assert effect.edge is not None
        (_, before), (_, after) = (forces(replace(effect, scale=scale * part), MOTION)[0] for part in (0.98, 1.02))
        size = np.abs(after - before).max()
        change = forces(effect.edge, MOTION)[0][1] * 0.04 * scale
        assert np.mean(np.abs(change - after + before)) < 0.02 * size
    assert GearEffect("error sine", "1", 1.0).edge is None


def test_stop_operator_loses_four_magnitudes_times_sliding_per_loop() -> None:
    """Work of a loop of amplitude A about a stop of range D: 4 (A - D) at magnitude 1; its slope is that of the way."""
    x = 1e-3 * np.sin(PHASE)
    phi, slope = along_period(GearEffect("stop", "1", 2e-4), x)
    loop = np.append(x, x[0])
    stays = slope[1:] == slope[:-1]
    assert np.diff(phi)[stays] == pytest.approx((slope[1:] * np.diff(x))[stays], abs=1e-9)
    middle = (phi + np.roll(phi, -1)) / 2
    assert np.sum(middle * np.diff(loop)) == pytest.approx(4 * (1e-3 - 2e-4), rel=1e-3)
    assert np.abs(phi).max() == 1.0


def test_a_bristle_follows_dahls_equation() -> None:
    x, D = 1e-3 * np.sin(PHASE), 3e-4
    phi, slope = along_period(GearEffect("bristle", "1", D), x)
    dx = np.gradient(x)
    rising = (dx > 0) & (np.roll(dx, 1) > 0) & (np.roll(dx, -1) > 0)
    assert np.gradient(phi)[rising] == pytest.approx(((1 - phi) / D * dx)[rising], rel=2e-2, abs=2e-5)
    assert np.all(slope >= 0)


def test_transmission_error_deflects_gear_and_pushes_motor() -> None:
    """No energy is lost: tau (q' (1 + e') - l') is what the spring stores."""
    effect = GearEffect("error cosine", "1", 2.0)
    (gear, across), (motor, at_motor) = forces(effect, MOTION)
    e, slope = transmission_error(effect, MOTION.angle, MOTION.ratio)
    assert (gear, motor) == ("gear", "motor")
    assert transmission_error(effect, np.zeros(1), MOTION.ratio)[0] == 1.0
    assert across == pytest.approx(MOTION.k * e + MOTION.d * slope * MOTION.velocity)
    assert at_motor == pytest.approx(MOTION.torque * slope)
    step = np.diff(MOTION.angle)
    assert np.diff(e) == pytest.approx((slope[1:] + slope[:-1]) / 2 * step, abs=1e-3)


def test_friction_brakes_and_grows_with_load() -> None:
    (_, constant), (_, load) = (forces(GearEffect(kind, "1"), MOTION)[0] for kind in ("friction", "load"))
    assert np.mean(constant * MOTION.velocity) == pytest.approx(np.mean(np.abs(MOTION.velocity)), rel=1e-4)
    assert load == pytest.approx(constant * np.abs(MOTION.torque))
