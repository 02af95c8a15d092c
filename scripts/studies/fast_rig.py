r"""A fast stand-in for the simulated rig: thousands of runs of a robot linearised in each configuration, by numba.

.. math:: M \delta\ddot q + D \delta\dot q + K \delta q = B (u - u_0 + w) - P F_c \tanh(P^T \dot q / v_s)

For the studies beside this file, which need more runs than the rig gives in a day. All else is the rig's: the sampled
controller with its encoders and its held torque, the Runge-Kutta steps in a sample in which a motor reverses, the
smoothed sign, the reference, the plan and the noise drawn from the same seed. A sample in which no motor reverses is
one exact step. Left out are the robot's nonlinear mechanics alone: a run of the rig differs by what the movement
changes in M and in gravity. Serial robots with Coulomb and viscous friction at uncoupled motors, logged at the motors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg import expm

from elastid.base.arrays import FloatArray
from elastid.experiment.plan.movement import movement
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.simulated.hardware import draw_noise, drives
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction.robot_friction import coulomb_levels
from elastid.friction.static import SLIDING_VELOCITY
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import formulate
from elastid.record import Configuration, Record
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.simulation.controller import rigid_motion, tune

# |v| that a motor must keep for a sample to be one step: over the velocity of the smoothed sign, over the change of v;
# |v| over that velocity from which on tanh is one.
MIN_SLIDING, MIN_CHANGE, MAX_TANH = 4.0, 0.5, 10.0
# Runs that are advanced side by side: their states stay in the processor's cache.
BLOCK_RUNS = 32


def at_rest(response: FrequencyResponse) -> FrequencyResponse:
    """A response of the stand-in, whose motion moves no posture: nothing of that is to be taken out."""
    return replace(response, motion=None)


@dataclass(frozen=True, eq=False)
class Step:
    """One classical Runge-Kutta step of x' = A x + B u - P f with f constant in each of its four stages.

    stage[i] (n_u, 2 n + n_u + 4 n_u): velocity of the motors in stage i from [x, u, f_1 .. f_4].
    end (2 n, 2 n + n_u + 4 n_u): x at the end from the same.
    """

    stage: FloatArray
    end: FloatArray

    @classmethod
    def of(cls, A: FloatArray, B: FloatArray, P: FloatArray, V: FloatArray, h: float) -> Step:
        """V (n_u, 2 n): from states to velocities of the motors."""
        n, n_u = B.shape
        size = n + n_u + 4 * n_u
        x, u = np.eye(n, size), B @ np.eye(n_u, size, n)
        f = [P @ np.eye(n_u, size, n + n_u + i * n_u) for i in range(4)]
        slope_1 = A @ x + u - f[0]
        x_2 = x + h / 2 * slope_1
        slope_2 = A @ x_2 + u - f[1]
        x_3 = x + h / 2 * slope_2
        slope_3 = A @ x_3 + u - f[2]
        x_4 = x + h * slope_3
        slope_4 = A @ x_4 + u - f[3]
        end = x + h / 6 * (slope_1 + 2 * slope_2 + 2 * slope_3 + slope_4)
        return cls(np.ascontiguousarray([V @ each for each in (x, x_2, x_3, x_4)]), np.ascontiguousarray(end))


@dataclass(frozen=True, eq=False)
class Posture:
    """All that the runs in one configuration share; n samples, n_u motors, link side.

    whole (2 n_q, 2 n_q + 2 n_u): the state after a sample from [x, u, f], all held.
    start (2 n_q,): the state.  angle (n_u,): of the motors at rest.  readout, speed (n_u, 2 n_q): of the motors' angles
    and velocities.
    position, velocity, torque (n, n_u): reference and feed-forward.  scale (n,): of the injected torque.
    gains (3, n_u): k_p, k_d, k_i.
    """

    configuration: Configuration
    step: Step
    whole: FloatArray
    start: FloatArray
    angle: FloatArray
    readout: FloatArray
    speed: FloatArray
    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    scale: FloatArray
    gains: FloatArray


@dataclass(frozen=True, eq=False)
class FastRig:
    """A robot of the rig with its section `experiment.simulated`, prepared for plans that differ in phases alone."""

    robot: Robot
    simulated: SimulatedSpec
    coulomb: FloatArray
    resolution: FloatArray
    postures: dict[str, Posture]

    @classmethod
    def of(cls, robot: Robot, simulated: SimulatedSpec, plan: Plan) -> FastRig:
        """Linearise the true robot in the configurations of a plan."""
        if robot.loops or simulated.outputs or not np.array_equal(robot.mixing, np.eye(len(plan.inputs))):
            raise ValueError(f"robot {robot.name} has loops, coupled motors or outputs beside its motors")
        linearisation = Linearisation.of(formulate(robot))
        hardware = drives(robot, simulated.noise.encoder_counts, (), (), False)
        postures = {c.name: _posture(linearisation, simulated, plan, c) for c in plan.configurations}
        return cls(robot, simulated, coulomb_levels(robot), hardware.resolution, postures)

    def measure(self, plan: Plan, seed: int) -> list[Record]:
        """All records of a plan with the noise of a seed, in the order of its experiments."""
        return [record for name in self.postures for record in self._measured(plan, seed, name)]

    def _measured(self, plan: Plan, seed: int, name: str) -> Iterator[Record]:
        """The records of one configuration."""
        there = [each for each in plan.experiments if each.configuration.name == name]
        for first in range(0, len(there), BLOCK_RUNS):
            block = there[first : first + BLOCK_RUNS]
            yield from self._advanced(plan, seed, self.postures[name], block)

    def _advanced(self, plan: Plan, seed: int, posture: Posture, block: Sequence[Experiment]) -> Iterator[Record]:
        names = [configuration.name for configuration in plan.configurations]
        noise = [
            draw_noise(
                self.simulated.noise,
                plan.run_samples,
                plan.rate_hz,
                len(plan.inputs),
                plan.inputs,
                (seed, names.index(e.configuration.name), e.realisation, e.experiment),
            )
            for e in block
        ]
        end = plan.run_samples - plan.first_sample
        sample = np.arange(-plan.first_sample, end - plan.first_sample)
        period = np.stack([plan.torque(e) for e in block], axis=2)
        injected = posture.scale[:end, None, None] * period[sample % len(period)]
        commanded = posture.torque[:end, :, None] + injected
        reading_noise = np.stack([one.reading[:end] for one in noise], axis=2)
        disturbance = np.stack([one.disturbance[:end] for one in noise], axis=2)
        read, u = _simulate(
            posture.whole, posture.step.stage, posture.step.end, posture.start, posture.readout, posture.speed,
            posture.angle,
            posture.position[:end], posture.velocity[:end], commanded, disturbance, reading_noise,
            posture.gains, self.resolution, self.coulomb, posture.torque[0], self.simulated.steps(plan.rate_hz, 0.0),
            plan.rate_hz,
        )  # fmt: skip
        measured = slice(end - plan.periods * plan.period_samples, end)
        for i, experiment in enumerate(block):
            yield Record(
                name=experiment.name,
                configuration=experiment.configuration,
                realisation=experiment.realisation,
                experiment=experiment.experiment,
                rate_hz=plan.rate_hz,
                period_samples=plan.period_samples,
                inputs=plan.inputs,
                outputs=plan.inputs,
                quantities=("position",) * len(plan.inputs),
                u=(u[:, :, i] + noise[i].torque[:end])[measured],
                y=(read[:, :, i] + noise[i].outputs[:end])[measured],
                r=np.tile(plan.torque(experiment), (plan.periods, 1)),
                hold="zero-order",
            )


def _posture(linearisation: Linearisation, spec: SimulatedSpec, plan: Plan, configuration: Configuration) -> Posture:
    model = linearisation.model
    linear = linearisation.at(configuration, model.theta, model.inputs, "position")
    point = equilibrium(model, model.theta, configuration)
    n, M, D, K = linear.n, linear.M, linear.D, linear.K
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    B = np.vstack([np.zeros(model.B.shape), np.linalg.solve(M, model.B)])
    V = np.hstack([np.zeros(model.B.T.shape), model.B.T])
    T = rigid_motion(model, point.q)
    path = movement(spec.carrier, plan)
    moved = (T @ path.position.T, T @ path.velocity.T, T @ path.acceleration.T)
    torque = point.u + (T.T @ (K @ moved[0] + D @ moved[1] + M @ moved[2])).T
    controller = spec.controller
    gains = tune(model, point.q, controller.bandwidth_hz, controller.damping_ratio, controller.velocity_integral_time)
    return Posture(
        configuration=configuration,
        step=Step.of(A, B, B, V, 1 / (plan.rate_hz * spec.steps(plan.rate_hz, 0.0))),
        whole=np.ascontiguousarray(_held(A, np.hstack([B, -B]), 1 / plan.rate_hz)),
        start=np.concatenate([T @ path.position[0], np.zeros(n)]),
        angle=model.B.T @ point.q,
        readout=np.hstack([model.B.T, np.zeros(model.B.T.shape)]),
        speed=V,
        position=configuration.angles + path.position,
        velocity=path.velocity,
        torque=torque,
        scale=path.scale,
        gains=np.stack([gains.kp, gains.kd, np.broadcast_to(gains.ki, gains.kp.shape)]),
    )


def _held(A: FloatArray, B: FloatArray, T: float) -> FloatArray:
    """[A_d, B_d] (n, n + m) of x' = A x + B u with u held over T."""
    n, m = B.shape
    return np.asarray(expm(T * np.vstack([np.hstack([A, B]), np.zeros((m, n + m))]))[:n])


@njit(cache=True)  # type: ignore[untyped-decorator]
def _simulate(
    whole, stage, end, start, readout, speed, angle, position, velocity, torque, disturbance, noise,
    gains, resolution, coulomb, holding, substeps, rate_hz,
):  # fmt: skip
    """Readings and held torques (n, n_u, runs); torque, disturbance, noise (n, n_u, runs)."""
    n, n_u, runs = torque.shape
    n_x = len(start)
    read, u = np.zeros((n, n_u, runs)), np.zeros((n, n_u, runs))
    z, after = np.zeros((n_x + 2 * n_u, runs)), np.zeros((n_x, runs))
    v, v_after = np.zeros((n_u, runs)), np.zeros((n_u, runs))
    integral, last = np.zeros((n_u, runs)), np.zeros((n_u, runs))
    one, state = np.zeros(stage.shape[2]), np.zeros(n_x)
    for a in range(n_x):
        z[a] = start[a]
    for i in range(n_u):
        last[i] = angle[i]
        for a in range(n_x):
            last[i] += readout[i, a] * start[a]
    for k in range(n):
        for i in range(n_u):
            for run in range(runs):
                q = angle[i]
                for a in range(n_x):
                    q += readout[i, a] * z[a, run]
                q += noise[k, i, run]
                if resolution[i] > 0:
                    q = resolution[i] * np.floor(q / resolution[i] + 0.5)
                error = gains[0, i] * (position[k, i] - q)
                error += gains[1, i] * (velocity[k, i] - (q - last[i, run]) * rate_hz)
                given = torque[k, i, run] + error + gains[2, i] * integral[i, run]
                integral[i, run] += error / rate_hz
                last[i, run] = q
                read[k, i, run] = q
                u[k, i, run] = given
                z[n_x + i, run] = given - holding[i] + disturbance[k, i, run]
        _apply(speed, z, v)
        for i in range(n_u):
            for run in range(runs):
                z[n_x + n_u + i, run] = coulomb[i] * np.tanh(v[i, run] / SLIDING_VELOCITY)
        _apply(whole, z, after)
        _apply(speed, after, v_after)
        for run in range(runs):
            if _may_turn(v[:, run], v_after[:, run], coulomb):
                one[: n_x + n_u] = z[: n_x + n_u, run]
                for _ in range(substeps):
                    _small_step(stage, end, coulomb, n_x, n_u, one, state)
                after[:, run] = one[:n_x]
        z[:n_x] = after
    return read, u


@njit(cache=True)  # type: ignore[untyped-decorator]
def _apply(matrix, z, found):  # type: ignore[no-untyped-def]
    """matrix z into found, run by run beside each other."""
    rows, size = matrix.shape
    found[:] = 0.0
    for b in range(rows):
        for a in range(size):
            weight = matrix[b, a]
            if weight != 0.0:
                for run in range(z.shape[1]):
                    found[b, run] += weight * z[a, run]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _may_turn(v, after, coulomb):  # type: ignore[no-untyped-def]
    """Whether a motor with friction reverses, nearly rests, or may have been at rest in between."""
    for i in range(len(v)):
        near = max(MIN_SLIDING * SLIDING_VELOCITY, MIN_CHANGE * abs(after[i] - v[i]))
        if coulomb[i] > 0 and (v[i] * after[i] <= 0 or min(abs(v[i]), abs(after[i])) < near):
            return True
    return False


@njit(cache=True, fastmath=True)  # type: ignore[untyped-decorator]
def _small_step(stage, end, coulomb, n_x, n_u, z, after):  # type: ignore[no-untyped-def]
    """One Runge-Kutta step of the state at the head of z, in place; after (n_x,): room to work."""
    for part in range(4):
        known = n_x + n_u + part * n_u
        for i in range(n_u):
            slip = 0.0
            for a in range(known):
                slip += stage[part, i, a] * z[a]
            slip /= SLIDING_VELOCITY
            z[known + i] = coulomb[i] * (np.tanh(slip) if abs(slip) < MAX_TANH else np.sign(slip))
    for b in range(n_x):
        total = 0.0
        for a in range(len(z)):
            total += end[b, a] * z[a]
        after[b] = total
    for b in range(n_x):
        z[b] = after[b]
