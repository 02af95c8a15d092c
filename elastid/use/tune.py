r"""A tuned move: motor references with torque feedforward, within limits, tested by simulation of posterior samples.

The drives of the simulated robot follow the references,

.. math:: u = u_{ff} + k_p (q_{ref} - q_m) + k_d (\dot q_{ref} - \dot q_m)

The simulation has the nonlinear elastic model with friction, sampled loops and clipped torques. Parameters may differ
between runs, so that one compiled plant simulates all posterior samples.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import DataError
from elastid.base.execution import Progress, no_progress
from elastid.experiment.simulated.plant import Plant, true_plant
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.linear.equilibrium import equilibrium
from elastid.record import Configuration, JointLoop
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands, simulate
from elastid.simulation.controller import tune
from elastid.use.commanded_robot import CommandedRobot
from elastid.use.moves import KINDS, MotionLimits, Move, References
from elastid.use.trajectory_optimisation import (
    Planned,
    best_plan,
    first_duration,
    margin_of,
    rigid_references,
    sample_plan,
    shortest,
)

RIGID, CATALOGUE, IDENTIFIED = "rigid feedforward", "elastic, catalogue", "elastic, identified"
PASSES = 5  # most plans with successively narrower bounds
_SPARE = 0.998  # factor on a narrowed bound
SETTLING_S = 0.6  # time after the move in which its residual vibration is evaluated
DAMPING_RATIO = 0.7  # of the drives' loops


@frozen_value
class Outcome:
    """Distance (N,) of the tool from its path over time, m, its largest and rms value in the move, and after the move.

    low, high (N,): 95 % interval by posterior samples, or None.
    """

    name: str
    error: FloatArray = labelled("distance of the tool from its path", "m", "time_s")
    low: FloatArray | None = labelled("lower end of 95 % of draws", "m", "time_s")
    high: FloatArray | None = labelled("upper end of 95 % of draws", "m", "time_s")
    largest: float = labelled("largest error in the move", "m")
    rms: float = labelled("rms error in the move", "m")
    static: float = labelled("error at rest after the move", "m")
    residual: float = labelled("largest vibration after the move", "m")


@dataclass(frozen=True, eq=False)
class SimulatedLoop:
    """Simulated robot with the position loops of its drives; parameters may differ between runs."""

    commanded: CommandedRobot
    robot: Robot
    plant: Plant
    gains: JointLoop

    @classmethod
    def of(
        cls, commanded: CommandedRobot, robot: Robot, start: FloatArray, rate_hz: float, bandwidth_hz: float,
        samples: int = 0, *, clips: bool = False,
    ) -> "SimulatedLoop":  # fmt: skip
        """Build the loop of a robot with gains of the commanded one, for runs that start at rest at `start` (n_u,).

        samples: approximate number of simulated samples.  clips: clip torques at their limits.  StudyError for poles
        that are too fast.
        """
        clips = clips and any(np.isfinite(joint.limits.torque) for joint in robot.driven)
        spec, posture = SimulatedSpec(model=commanded.spec, saturation=clips), Configuration("start", start)
        plant = true_plant(robot, spec, rate_hz, posture, samples=samples, is_free=True, has_theta=True)
        gains = tune(commanded.model, commanded.rigid_posture(start), bandwidth_hz, DAMPING_RATIO)
        return cls(commanded, robot, plant, gains)

    def follow(self, references: References, robot: Robot | None = None) -> tuple[FloatArray, FloatArray]:
        """Simulate q (N, n_q) and the torque (N, n_u) of this robot, or of one with other numbers, from rest.

        DataError if the simulation diverges, StudyError without an equilibrium at the start.
        """
        table = (robot or self.robot).parameters()
        model = self.plant.model
        theta = np.array([table[name][0] for name in model.parameters])
        q_0 = equilibrium(model, theta, Configuration("start", references.position[0])).q
        # The same difference quotient as the loop's, so that its torque depends on the error alone.
        velocity = np.diff(references.position, axis=0, prepend=references.position[:1]) * references.rate_hz
        zeros = np.zeros_like(velocity)
        commands = Commands(references.position, velocity, references.torque, zeros, zeros)
        try:
            motion = simulate(self.plant.loop, self.gains, commands, q_0, theta=theta)
        except DataError as error:
            advice = "lower --bandwidth, or raise --rate"
            if robot is not None:
                advice = "the robot is a posterior sample. Fix poorly known parameters of the fit, or give --samples 0"
            raise DataError("experiment/diverged", f"{error}; {advice}") from error
        return motion.q, motion.u

    def outcome(self, name: str, references: References, target: FloatArray, end_s: float) -> Outcome:
        """Simulate the references of a move that ends at end_s; return the error from the path target (N, 3)."""
        q, _ = self.follow(references)
        offset = self.commanded.poses(q, self.robot).position - target
        error, is_after = np.linalg.norm(offset, axis=1), references.time_s > end_s
        # The static error is the mean of the last 0.1 s.
        static = offset[-max(1, round(0.1 * references.rate_hz)) :].mean(axis=0)
        residual = np.linalg.norm(offset[is_after] - static, axis=1).max(initial=0.0)
        of_move = error[~is_after]
        figures = float(of_move.max()), float(np.sqrt(np.mean(of_move**2))), float(np.linalg.norm(static))
        return Outcome(name, error, None, None, *figures, float(residual))


@frozen_value
class TunedMove(References):
    """References of a move for the motors `joints`, and its simulated outcomes.

    target (N, 3): path of the frame's origin in the base's axes.  limits (4, n_u): of KINDS.  outcomes: simulated with
    the robot `judge`.  samples: number of posterior samples whose torques and velocities are within the limits, too;
    their errors are relative to the path of their rigid robot.
    """

    name: str
    frame: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    judge: str
    bandwidth_hz: float
    duration: float = labelled("duration of the move", "s")
    margin_s: float = labelled("time before and after the move", "s")
    target: FloatArray = labelled("path of the frame", "m", "time_s axis")
    predicted_error: FloatArray = labelled("error of the tool as planned", "m", "time_s")
    limits: FloatArray = labelled("largest velocity, acceleration, jerk, torque", "", "kind joints")
    outcomes: tuple[Outcome, ...]
    samples: int
    max_torque: FloatArray = labelled("largest torque of each motor on draws", "N*m", "joints")
    geometric_error_m: float = labelled("error of the path by lengths and zeros, 95 % of draws", "m")
    advice: str = ""

    def __getitem__(self, name: str) -> Outcome:
        """Return an outcome by its name."""
        return {outcome.name: outcome for outcome in self.outcomes}[name]


@dataclass(frozen=True)
class MoveRobots:
    """Identified, nominal (catalogue) and judging robot of a move, and posterior samples (draws).

    bandwidth_hz: of the drives' loops.  rate_hz: of their references.  error_m: tolerance of the tool's path.
    """

    identified: Robot
    catalogue: Robot
    judge: Robot
    judge_name: str
    draws: Sequence[Robot]
    frame: str
    rate_hz: float
    bandwidth_hz: float
    error_m: float


def tune_move(robots: MoveRobots, move: Move, name: str, progress: Progress = no_progress) -> TunedMove:
    """Tune the references of a move and simulate them; a move without a duration takes the shortest time.

    DataError if no motion is within the limits, or no duration is accurate enough.
    """
    commanded = CommandedRobot.of(robots.identified, robots.frame, move.ends[0])
    task = _MoveTask(robots, commanded, move, MotionLimits.of(robots.identified), margin_of(commanded, move))
    if not move.duration:
        if not first_duration(commanded, move, task.limits):
            raise DataError(
                "use/move",
                f"robot {robots.identified.name} has no limits of velocity, acceleration or torque, so that no "
                "shortest time exists. Give limits for its joints, or give a duration",
            )
        limits = task.limits.narrowed({kind: np.full(len(task.limits.torque), _SPARE**2) for kind in KINDS})
        fastest = shortest(commanded, move, limits, task.margin_s, robots.error_m)
        if fastest is None:
            raise DataError(
                "use/move",
                f"no duration keeps the tool within {1e3 * robots.error_m:g} mm of its path. Raise --error, or move "
                "the path away from limits and singular postures",
            )
        task = replace(task, move=fastest)
    return task.tuned(name, progress)


@dataclass(frozen=True, eq=False)
class _MoveTask:
    """A move with its robots, the limits of the motors, and the time before and after it."""

    robots: MoveRobots
    commanded: CommandedRobot
    move: Move
    limits: MotionLimits
    margin_s: float

    def tuned(self, name: str, progress: Progress) -> TunedMove:
        """Plan the move within limits and simulate its outcomes."""
        robots, limits, joints = self.robots, self.limits, self.commanded.robot.driven
        planned, r, errors, max_torque = self._within_limits(progress)
        target = self._path(r.time_s)
        distances = [np.linalg.norm(self._path(r.time_s, robot) - target, axis=1).max() for robot in robots.draws]
        position = self.commanded.poses(planned.q(np.clip(r.time_s, *planned.q.t[[0, -1]]))).position
        error = np.linalg.norm(position - target, axis=1)
        advice = ""
        k = int(np.argmax(error))
        if error[k] > robots.error_m:
            advice = (
                f"the tool leaves its path by {1e3 * error[k]:.3g} mm {r.time_s[k]:.3g} s after the start. Give the "
                "move more time: --fastest finds the shortest"
            )
        return TunedMove(
            **vars(r), name=name, frame=robots.frame, joints=tuple(joint.name for joint in joints),
            units=tuple(joint.unit for joint in joints), judge=robots.judge_name, bandwidth_hz=robots.bandwidth_hz,
            duration=self.move.duration, margin_s=self.margin_s, target=target, predicted_error=error,
            limits=np.array([getattr(limits, kind) for kind in KINDS]),
            outcomes=self._outcomes(r, target, errors), samples=len(robots.draws), max_torque=max_torque, advice=advice,
            geometric_error_m=float(np.quantile(distances, 0.95)) if distances else 0.0,
        )  # fmt: skip

    def _path(self, time_s: FloatArray, robot: Robot | None = None) -> FloatArray:
        """Return the path (N, 3) of the frame on the rigid commanded robot, or on one with other numbers."""
        return self.commanded.poses(self.commanded.rigid(self.move, time_s)[0], robot).position

    def _within_limits(self, progress: Progress) -> tuple[Planned, References, FloatArray, FloatArray]:
        """Return a plan within the limits, its references, errors (D, N) of samples, and their largest torque (n_u,).

        Bounds are narrowed if references between knots, or posterior samples with feedback, exceed the limits.
        """
        robots, commanded, limits = self.robots, self.commanded, self.limits
        n = len(robots.draws)
        samples = round((self.move.duration + 2 * self.margin_s + SETTLING_S) * robots.rate_hz) * n
        start, hz = self.move.ends[0], (robots.rate_hz, robots.bandwidth_hz)
        loop = SimulatedLoop.of(commanded, robots.identified, start, *hz, samples)
        narrowed = limits
        for attempt in range(PASSES):
            progress(attempt * (n + 1), PASSES * (n + 1))
            planned = best_plan(commanded, self.move, narrowed, self.margin_s)
            references = sample_plan(commanded, planned, robots.rate_hz, SETTLING_S)
            # At rest, motors may be beyond their limits, because gravity deflects the robot.
            if not planned.is_feasible or np.any(references.use(limits)["angle"][[0, -1]] > 1):
                raise DataError(
                    "use/move",
                    f"no motion within the limits takes {self.move.duration:.4g} s. Give the move more time (--fastest "
                    "finds the shortest), or ends at which the motors can hold the robot against gravity",
                )
            fractions = {kind: references.use(limits)[kind].max(axis=0) for kind in KINDS}
            errors, max_torque = [], np.abs(references.torque).max(axis=0)
            for i, robot in enumerate(robots.draws):
                q, torque = loop.follow(references, robot)
                path = self._path(references.time_s, robot)
                errors.append(np.linalg.norm(commanded.poses(q, robot).position - path, axis=1))
                max_torque = np.maximum(max_torque, np.abs(torque).max(axis=0))
                velocity = np.abs(np.diff(q @ commanded.model.B, axis=0)).max(axis=0) * robots.rate_hz
                fractions["velocity"] = np.maximum(fractions["velocity"], velocity / limits.velocity)
                progress(attempt * (n + 1) + i + 1, PASSES * (n + 1))
            fractions["torque"] = np.maximum(fractions["torque"], max_torque / limits.torque)
            if all(np.all(x <= 1.0) for x in fractions.values()):
                return planned, references, np.array(errors), max_torque
            factors = {kind: np.where(x > 1, _SPARE / np.maximum(x, 1.0), 1.0) for kind, x in fractions.items()}
            narrowed = narrowed.narrowed(factors)
        kind = max(fractions, key=lambda key: float(fractions[key].max()))
        joint = commanded.robot.driven[int(np.argmax(fractions[kind]))].name
        raise DataError(
            "use/move",
            f"no plan keeps the {kind} limit of joint {joint} on {n} posterior samples: the last plan uses "
            f"{100 * fractions[kind].max():.4g} % of it. Give the move more time, or lower --bandwidth to reduce the "
            "torque of the feedback",
        )

    def _outcomes(self, references: References, target: FloatArray, drawn: FloatArray) -> tuple[Outcome, ...]:
        """Simulate feedforward of rigid, catalogue and identified robot on `judge`; drawn (D, N): errors of samples."""
        robots, move = self.robots, self.move
        start, hz, samples = move.ends[0], (robots.rate_hz, robots.bandwidth_hz), 3 * len(references.time_s)
        judge = SimulatedLoop.of(self.commanded, robots.judge, start, *hz, samples, clips=True)
        of_catalogue = CommandedRobot.of(robots.catalogue, robots.frame, start, self.commanded.spec)
        elastic = best_plan(of_catalogue, move, MotionLimits.of(robots.catalogue), self.margin_s)
        commands = {
            RIGID: rigid_references(robots.catalogue, of_catalogue, move, references.time_s),
            CATALOGUE: sample_plan(of_catalogue, elastic, robots.rate_hz, SETTLING_S),
            IDENTIFIED: references,
        }
        outcomes = [judge.outcome(name, command, target, move.duration) for name, command in commands.items()]
        if len(drawn):
            low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
            outcomes[-1] = replace(outcomes[-1], low=low, high=high)
        return tuple(outcomes)
