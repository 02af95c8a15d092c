"""The best shaper of a region on the nonlinear twin: what is left of the vibration of the tool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.fitted_models import fitted_model

from elastid.base.arrays import FloatArray
from elastid.fit.posture import Asked
from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import formulate
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.robot.simplified import without_dry_friction
from elastid.simulation.controller import tune
from elastid.use.command.moves import References
from elastid.use.command.replay import DAMPING_RATIO, TwinLoop
from elastid.use.command.shapers import TOLERATED, ranked_shapers, region_modes
from elastid.use.draws import estimated_robot

RATE_HZ, BANDWIDTH_HZ, MOVE_S, REST_S = 500.0, 4.0, 0.01, 2.0
POSTURES = np.radians([[-20.0, 20.0, -10.0], [10.0, 30.0, -30.0], [35.0, 45.0, -45.0]])


@pytest.mark.slow
def test_the_best_shaper_leaves_five_per_cent_in_every_posture() -> None:
    """Of small steps of all motors at once about postures of the region: nothing is damped before it is counted."""
    fitted = fitted_model("arm")
    result = replace(fitted.result, robot=fitted.robot)
    family = result.family(Asked())
    robot = replace(without_dry_friction(estimated_robot(result)), frames=family.robot.frames)
    best = ranked_shapers(region_modes(result, POSTURES, BANDWIDTH_HZ))[0]
    assert best.suffices
    share = np.clip(np.arange(round(REST_S * RATE_HZ)) / (MOVE_S * RATE_HZ), 0, 1)
    way = 1e-3 * (3 * share**2 - 2 * share**3)[:, None] * np.ones(3)
    model = formulate(robot)
    for angles in POSTURES:
        rest = equilibrium(model, model.theta, Configuration("rest", angles))
        gains = tune(model, rest.q, BANDWIDTH_HZ, DAMPING_RATIO)
        loop = TwinLoop.of(robot, model, family.frame, gains, RATE_HZ)
        plain = vibration(loop, angles + way, rest.u, MOVE_S)
        shaped = vibration(loop, angles + best.shaped(way, RATE_HZ), rest.u, MOVE_S + best.delay_s)
        assert shaped < TOLERATED * plain, angles


def vibration(loop: TwinLoop, position: FloatArray, holding: FloatArray, end_s: float) -> float:
    """Largest distance of the tool, after a move, from where it comes to rest."""
    t, none = np.arange(len(position)) / RATE_HZ, np.zeros_like(position)
    q, _ = loop.follow(References(t, position, none, none, none, np.tile(holding, (len(t), 1))))
    at = frame_poses(loop.robot, q[:, : len(loop.robot.joints)], loop.frame).position
    return float(np.linalg.norm(at[t > end_s] - at[-1], axis=1).max())
