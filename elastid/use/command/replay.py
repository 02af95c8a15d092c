r"""A robot along given references in the loops of its drives, simulated forwards, and the error of its tool.

.. math:: u = u_{ff} + k_p (q_{ref} - q_m) + k_d (\dot q_{ref} - \dot q_m)

The nonlinear elastic model with friction, sampled loops, torques clipped at their limits. Numbers of the robot may
change from run to run, so that draws of what a fit knows are judged by one function.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import DataError
from elastid.experiment.simulated.hardware import drives
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.closed_loop import ClosedLoop, Commands, closed_loop, simulate
from elastid.simulation.controller import Gains
from elastid.simulation.dynamics import affordable_steps, contacts, poles
from elastid.use.command.moves import References

SETTLING_S = 0.6  # after the move, in which its residual vibration is judged
DAMPING_RATIO = 0.7  # of the loops of the drives


@frozen_value
class Outcome:
    """Error of the tool along a move, m: over time (N,), and in figures.

    largest, rms: within the move.  static: distance from the path's end after it.  residual: largest distance from
    there after the move.  torque (n_u,): largest of the drives, link side.  low, high (N,): 95 % of draws, or None.
    """

    name: str
    error: FloatArray = labelled("distance of the tool from its path", "m", "time_s")
    low: FloatArray | None = labelled("lower end of 95 % of draws", "m", "time_s")
    high: FloatArray | None = labelled("upper end of 95 % of draws", "m", "time_s")
    largest: float = labelled("largest error in the move", "m")
    rms: float = labelled("rms error in the move", "m")
    static: float = labelled("error at rest after the move", "m")
    residual: float = labelled("largest vibration after the move", "m")
    torque: FloatArray = labelled("largest torque of each motor, link side", "N*m", "joints")


@dataclass(frozen=True, eq=False)
class TwinLoop:
    """A robot in the loops of its drives, its numbers given run by run."""

    robot: Robot
    model: ElasticModel
    loop: ClosedLoop
    gains: Gains
    frame: str

    @classmethod
    def of(
        cls, robot: Robot, model: ElasticModel, frame: str, gains: Gains, rate_hz: float, samples: int = 0,
        *, clips: bool = False,
    ) -> TwinLoop:  # fmt: skip
        """Loop of a robot with `model`; samples: about how many will be simulated; clips: torques at their limits.

        StudyError for poles that are too fast.

        The steps are short enough for its fastest pole in the start posture, with a fifth to spare for draws.
        """
        placed = contacts(model, frictions(robot))
        q = np.zeros(model.n_q)
        start = np.array([joint.start for joint in robot.driven])
        q = equilibrium(model, model.theta, Configuration("start", start)).q if robot.loops else q
        substeps = affordable_steps(1.2 * poles(model, placed, q), rate_hz, robot.name)
        clips = clips and any(np.isfinite(joint.limits.torque) for joint in robot.driven)
        hardware = drives(robot, 0, (), (), clips)
        limits = np.tile([-np.inf, np.inf], (model.n_u, 1))
        loop = closed_loop(model, placed, limits, rate_hz, substeps, hardware, samples, of_numbers=True)
        return cls(robot, model, loop, gains, frame)

    def follow(self, references: References, robot: Robot | None = None) -> tuple[FloatArray, FloatArray]:
        """q (N, n_q), torque of the drives (N, n_u) of this robot, or another of its kind, from rest.

        DataError where a motor is lost, StudyError where it finds no rest at the start.
        """
        table = (robot or self.robot).parameters()
        theta = np.array([table[name][0] for name in self.model.parameters])
        rest = equilibrium(self.model, theta, Configuration("start", references.position[0])).q
        # As the loop differentiates what it reads, so that its torque is of the error alone.
        velocity = np.diff(references.position, axis=0, prepend=references.position[:1]) * references.rate_hz
        none = np.zeros_like(velocity)
        commands = Commands(references.position, velocity, references.torque, none, none)
        try:
            moved = simulate(self.loop, self.gains, commands, rest, theta=theta)
        except DataError as error:
            advice = "lower --bandwidth, or raise --rate"
            if robot is not None:
                advice = (
                    "this is a robot drawn from the fit, whose intervals hold robots that no loop moves: fix or leave "
                    "out what is at a bound or hardly known, or give --draws 0"
                )
            raise DataError("experiment/diverged", f"{error}; {advice}") from error
        return moved.q, moved.u

    def tool(self, q: FloatArray, robot: Robot) -> FloatArray:
        """Place (N, 3) of the frame of a robot of this kind at q (N, n_q)."""
        return frame_poses(robot, q[:, : len(robot.joints)], self.frame).position

    def outcome(self, name: str, references: References, target: FloatArray, end_s: float) -> Outcome:
        """The error from target (N, 3) of a move that ends at end_s."""
        q, torque = self.follow(references)
        at = self.tool(q, self.robot) - target
        error, after = np.linalg.norm(at, axis=1), references.time_s > end_s
        # The static error is the mean of the last 0.1 s.
        static = at[-max(1, round(0.1 * references.rate_hz)) :].mean(axis=0)
        residual = np.linalg.norm(at[after] - static, axis=1).max(initial=0.0)
        within = error[~after]
        figures = float(within.max()), float(np.sqrt(np.mean(within**2))), float(np.linalg.norm(static))
        return Outcome(name, error, None, None, *figures, float(residual), np.abs(torque).max(axis=0))
