"""What records show of their motors' motion: its spectra, its mean, and the feedback of the controller."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elastid.frf.estimate import motor_motion
from elastid.record import Configuration, Record
from elastid.response import Response

RATE_HZ, N, PERIODS = 500.0, 1000, 3
EXCITED, CARRIER, DISTORTED = np.arange(9, 90, 4), 2, np.arange(10, 90, 8)
MOTORS = ("motor 1", "motor 2")
POSTURE = np.array([0.4, -0.9])
FEEDBACK = np.array([np.diag([3e4, 0.0]), [[9e3, 100.0], [50.0, 4e3]], np.diag([300.0, 120.0])])


def records(velocities: bool = False) -> tuple[tuple[Record, ...], np.ndarray]:
    """Two experiments of motors under a controller, and the mean squares (2, 2) of the excited lines together."""
    rng, t, known, power = np.random.default_rng(3), np.arange(N * PERIODS) / RATE_HZ, [], np.zeros((2, 2))
    s = 2j * np.pi * RATE_HZ / N * np.arange(N // 2)
    for e in range(2):
        q = np.zeros((N // 2, 2), complex)
        for lines, size in ((EXCITED, 1e-3), ([CARRIER], 1e-2), (DISTORTED, 2e-5)):
            q[lines] = size * (rng.standard_normal((len(lines), 2)) + 1j * rng.standard_normal((len(lines), 2)))
        power += np.real(q[EXCITED].T @ q[EXCITED].conj()) / 4
        r = np.zeros_like(q)
        r[EXCITED] = 50.0 * rng.standard_normal((len(EXCITED), 2))
        over = np.where(s == 0, 1, s)[:, None]
        u = r - np.einsum("iab,kib->ka", FEEDBACK, np.stack([q / over, q, q * s[:, None]], axis=1))
        wave = np.exp(np.outer(t, s))
        y = (wave @ (q * s[:, None] if velocities else q)).real + (0 if velocities else POSTURE)
        quantity = ("velocity" if velocities else "position",) * 2
        fixed = f"{e}", Configuration("c", POSTURE), 0, e, RATE_HZ, N, MOTORS, MOTORS, quantity
        known.append(Record(*fixed, (wave @ u).real, y, (wave @ r).real))
    return tuple(known), power


def response() -> Response:
    """Of the excited lines."""
    G = np.ones((len(EXCITED), 2, 2), complex)
    return Response(EXCITED * RATE_HZ / N, G, MOTORS, MOTORS, "acceleration", Configuration("c", POSTURE))


@pytest.mark.parametrize("velocities", [False, True])
@pytest.mark.parametrize("injected", [False, True])
def test_motion_and_feedback_are_those_of_the_records(velocities: bool, injected: bool) -> None:
    """Mean squares of angles, the carrier's among them, and F at all lines where the injected torque is known.

    Without it the lines between the excited ones show F, where distortion moves the motors.
    """
    logs, power = records(velocities)
    found = motor_motion(logs if injected else [replace(log, r=None) for log in logs], response())
    assert found is not None
    assert found.feedback is not None
    in_band = np.isin(np.rint(found.freq_hz * N / RATE_HZ), EXCITED)
    np.testing.assert_allclose(found.power[in_band].sum(axis=0).real, power, rtol=1e-9)
    assert found.freq_hz[0] == CARRIER * RATE_HZ / N
    assert found.rms.min() > 1e-3
    np.testing.assert_allclose(found.mean, np.full(2, np.nan) if velocities else POSTURE, atol=1e-9)
    np.testing.assert_allclose(found.feedback, FEEDBACK, rtol=1e-6, atol=0.1)


def test_torques_that_no_feedback_explains_show_none() -> None:
    """Of torques that are noise; and nothing is known of motion where no motor was logged."""
    logs, _ = records()
    rng = np.random.default_rng(0)
    noise = [replace(log, u=1e5 * rng.standard_normal(log.u.shape)) for log in logs]
    found = motor_motion(noise, response())
    assert found is not None
    assert found.feedback is None
    assert motor_motion([replace(log, outputs=("joint 1", "joint 2")) for log in logs], response()) is None
