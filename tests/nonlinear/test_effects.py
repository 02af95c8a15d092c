"""Shapes of gear effects against their closed forms, and slopes against differences."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.nonlinear.effects import GearEffect, GearMotion, forces, implicit_law, periodic_error

PHASE = 2 * np.pi * np.arange(800) / 800
MOTION = GearMotion(
    angle=0.02 * np.sin(PHASE), velocity=0.1 * np.cos(PHASE), link_velocity=0.1 * np.cos(PHASE - 0.1),
    deflection=1e-3 * np.sin(PHASE + 0.3), torque=200 * np.sin(PHASE + 0.3), ratio=100.0, k=2e5, d=60.0,
)  # fmt: skip


@pytest.mark.parametrize("kind", ["cubic", "progressive", "range", "gap"])
def test_slopes_are_those_of_the_law(kind: str) -> None:
    effect, x, h = GearEffect(kind, "1", 0.02), 0.03 * np.sin(PHASE), 1e-7  # type: ignore[arg-type]
    difference = (implicit_law(effect, x + h)[0] - implicit_law(effect, x - h)[0]) / (2 * h)
    assert implicit_law(effect, x)[1] == pytest.approx(difference, rel=1e-6, abs=1e-6)


def test_an_edge_is_the_change_of_an_effect_with_its_scale() -> None:
    for kind, scale in (("behind", 0.02), ("load", 0.02), ("stop", 3e-4), ("gap", 3e-4)):
        effect = GearEffect(kind, "1", scale)  # type: ignore[arg-type]
        assert effect.edge is not None
        (_, before), (_, after) = (forces(replace(effect, scale=scale * part), MOTION)[0] for part in (0.98, 1.02))
        size = np.abs(after - before).max()
        change = forces(effect.edge, MOTION)[0][1] * 0.04 * scale
        assert np.mean(np.abs(change - after + before)) < 0.02 * size
    assert GearEffect("error sine", "1", 1.0).edge is None


def test_a_stop_loses_four_levels_times_what_it_slides_in_a_loop() -> None:
    """Work of a loop of amplitude A about a stop of range D: 4 (A - D) for level 1."""
    x = 1e-3 * np.sin(PHASE)
    phi = implicit_law(GearEffect("stop", "1", 2e-4), x)[0]
    loop = np.append(x, x[0])
    middle = (phi + np.roll(phi, -1)) / 2
    assert np.sum(middle * np.diff(loop)) == pytest.approx(4 * (1e-3 - 2e-4), rel=1e-3)
    assert np.abs(phi).max() == 1.0


def test_a_bristle_follows_dahls_equation() -> None:
    x, D = 1e-3 * np.sin(PHASE), 3e-4
    phi, slope = implicit_law(GearEffect("bristle", "1", D), x)
    dx = np.gradient(x)
    rising = (dx > 0) & (np.roll(dx, 1) > 0) & (np.roll(dx, -1) > 0)
    assert np.gradient(phi)[rising] == pytest.approx(((1 - phi) / D * dx)[rising], rel=2e-2, abs=2e-5)
    assert np.all(slope >= 0)


def test_a_transmission_error_bends_the_gear_and_pushes_the_motor_by_its_slope() -> None:
    """No energy is lost: tau (q' (1 + e') - l') is what the spring stores."""
    effect = GearEffect("error cosine", "1", 2.0)
    (gear, across), (motor, at_motor) = forces(effect, MOTION)
    e, slope = periodic_error(effect, MOTION.angle, MOTION.ratio)
    assert (gear, motor) == ("gear", "motor")
    assert across == pytest.approx(MOTION.k * e + MOTION.d * slope * MOTION.velocity)
    assert at_motor == pytest.approx(MOTION.torque * slope)
    step = np.diff(MOTION.angle)
    assert np.diff(e) == pytest.approx((slope[1:] + slope[:-1]) / 2 * step, abs=1e-3)


def test_friction_brakes_and_grows_with_load() -> None:
    (_, constant), (_, load) = (forces(GearEffect(kind, "1"), MOTION)[0] for kind in ("friction", "load"))
    assert np.mean(constant * MOTION.velocity) == pytest.approx(np.mean(np.abs(MOTION.velocity)), rel=1e-4)
    assert load == pytest.approx(constant * np.abs(MOTION.torque))
