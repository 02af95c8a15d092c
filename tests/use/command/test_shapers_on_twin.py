"""The best shaper of a region on the nonlinear twin: what is left of the vibration of the tool."""

from __future__ import annotations

import numpy as np
import pytest
from plants.fitted_models import fitted_model

from elastid.base.arrays import FloatArray
from elastid.fit.posture import Asked
from elastid.linear.equilibrium import equilibrium
from elastid.record import Configuration
from elastid.robot.simplified import without_friction
from elastid.simulation.controller import tune
from elastid.use.command.limits import References
from elastid.use.command.replay import DAMPING_RATIO, TwinLoop
from elastid.use.command.shapers import TOLERATED, ranked_shapers, region_modes

RATE_HZ, BANDWIDTH_HZ, MOVE_S, REST_S = 500.0, 4.0, 0.06, 2.0
POSTURES = np.radians([[-20.0, 20.0, -10.0], [10.0, 30.0, -30.0], [35.0, 45.0, -45.0]])


@pytest.mark.slow
def test_the_best_shaper_leaves_five_per_cent_in_every_posture() -> None:
    """Of small moves of all motors at once, about each posture, positions and velocities shaped alike.

    The modes of the region are those of postures between and at them.
    """
    result = fitted_model("arm").result
    robot = without_friction(result.family(Asked()).robot.with_parameters(
        {p: v for p, v in zip(result.parameters.names, result.theta.tolist(), strict=True) if p.startswith(("k_", "d_"))}
    ))  # fmt: skip
    modes = region_modes(result, POSTURES, BANDWIDTH_HZ)
    best = ranked_shapers(modes)[0]
    assert best.suffices
    for angles in POSTURES:
        model = result.family(Asked()).model
        gains = tune(model, equilibrium(model, model.theta, Configuration("p", angles)).q, BANDWIDTH_HZ, DAMPING_RATIO)
        loop = TwinLoop.of(robot, loop_model(robot), result.family(Asked()).frame, gains, RATE_HZ)
        share = np.clip(np.arange(round(REST_S * RATE_HZ)) / (MOVE_S * RATE_HZ), 0, 1)
        way = 1e-3 * (3 * share**2 - 2 * share**3)[:, None] * np.ones(3)
        plain, shaped = (vibration(loop, angles, signal, end) for signal, end in (
            (way, MOVE_S), (best.shaped(way, RATE_HZ), MOVE_S + best.delay_s)))  # fmt: skip
        assert shaped < 1.2 * TOLERATED * plain, angles


def loop_model(robot: object) -> object:
    from elastid.model.formulation import formulate

    return formulate(robot)  # type: ignore[arg-type]


def vibration(loop: TwinLoop, angles: FloatArray, way: FloatArray, end_s: float) -> float:
    """Largest distance of the tool, after the move, from where it comes to rest."""
    model = loop.model
    held = equilibrium(model, model.theta, Configuration("p", angles)).u
    N = len(way)
    t = np.arange(N) / RATE_HZ
    none = np.zeros((N, model.n_u))
    references = References(t, angles + way, none, none, none, np.tile(held, (N, 1)))
    q, _ = loop.follow(references)
    from elastid.model.kinematics import frame_poses

    at = frame_poses(loop.robot, q[:, : len(loop.robot.joints)], loop.frame).position
    return float(np.linalg.norm(at[t > end_s] - at[-1], axis=1).max())
