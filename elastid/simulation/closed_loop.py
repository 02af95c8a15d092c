"""Plant, friction, joint controller and encoders over time: a sampled loop around a continuous robot.

In every sample the controller reads the encoders, computes a torque and holds it until the next sample; the plant is
integrated in between. All noise comes in as signals, drawn before: the same commands give the same motion.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from elastid.arrays import FloatArray, frozen
from elastid.errors import DataError
from elastid.model.elastic import ElasticModel
from elastid.simulation.constrained import projection
from elastid.simulation.controller import Gains, feedback
from elastid.simulation.dynamics import acceleration, runge_kutta
from elastid.simulation.spec import StabilisationSpec

# Samples between two looks at the result: a few hundredths of a second of computing, so that Ctrl-C is heard.
CHUNK = 1000

# rad on the link side. A joint that is a whole turn from its reference is not coming back.
LOST = 2 * np.pi

PROJECTED = StabilisationSpec()


@dataclass(frozen=True)
class Commands:
    """What comes from outside, each (n, n_u), link side: rad, rad/s, Nm.

    position, velocity: reference.  torque: feed-forward and injection.  disturbance: torque that the log does not
    know.  reading_noise: added to the motor angle before the encoder counts it.
    """

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    disturbance: FloatArray
    reading_noise: FloatArray

    def __post_init__(self) -> None:
        """Freeze and check shapes."""
        for name in ("position", "velocity", "torque", "disturbance", "reading_noise"):
            object.__setattr__(self, name, frozen(getattr(self, name)))
            if getattr(self, name).shape != self.position.shape:
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, position {self.position.shape}")


@dataclass(frozen=True)
class Trajectory:
    """What happened, at the sampling instants: q (n, n_q) true, reading (n, n_u) of the encoders, u (n, n_u) held."""

    q: FloatArray
    reading: FloatArray
    u: FloatArray


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A robot under its controller, ready to run: CHUNK samples of it as one CasADi function.

    limits (n_u, 2): angles in rad that the motors may take, link side.
    """

    inputs: tuple[str, ...]
    limits: FloatArray
    B: FloatArray
    rate_hz: float
    function: ca.Function


def closed_loop(
    model: ElasticModel,
    coulomb: FloatArray,
    limits: FloatArray,
    rate_hz: float,
    substeps: int,
    resolution: FloatArray,
    loops: StabilisationSpec = PROJECTED,
) -> ClosedLoop:
    """Close the loop around a model with Coulomb friction (n_u,) in Nm, link side.

    substeps: Runge-Kutta steps in a sample.  resolution (n_u,): rad per encoder count, link side, 0 for unlimited.
    loops: how they are kept closed.
    """
    q, v = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q)
    names = ("last", "position", "velocity", "torque", "disturbance", "reading_noise", "kp", "kd")
    signals = [ca.SX.sym(name, model.n_u) for name in names]
    last, position, velocity, torque, disturbance, noise, kp, kd = signals
    reading = _counted(ca.DM(model.B).T @ q + noise, resolution)
    u = torque + feedback(reading, last, position, velocity, kp, kd, rate_hz)
    step = runge_kutta(acceleration(model, coulomb, loops.alpha, loops.beta), 1 / (rate_hz * substeps), substeps)
    q_next, v_next = step(q, v, u + disturbance)
    if model.n_c and loops.project:
        q_next, v_next = projection(model)(q_next, v_next)
    sample = ca.Function("sample", [q, v, *signals], [q_next, v_next, reading, u])
    return ClosedLoop(model.inputs, limits, model.B, rate_hz, sample.mapaccum("closed_loop", CHUNK, 3, {}))


def simulate(loop: ClosedLoop, gains: Gains, commands: Commands, q0: FloatArray) -> Trajectory:
    """Run the loop from rest in q0 (n_q,) over the n samples of the commands.

    Raises DataError where a motor leaves its limits or is lost.
    """
    n, n_u = commands.position.shape
    signals = [getattr(commands, field.name) for field in fields(commands)]
    signals += [np.broadcast_to(gain, (n, n_u)) for gain in (gains.kp, gains.kd)]
    state = [q0, np.zeros(len(q0)), loop.B.T @ q0]
    chunks = []
    for start in range(0, n, CHUNK):
        block = [signal[start : start + CHUNK] for signal in signals]
        padding = ((0, CHUNK - len(block[0])), (0, 0))
        q, v, reading, u = (
            np.array(result.full())
            for result in loop.function(*state, *(np.pad(part, padding, mode="edge").T for part in block))
        )
        chunks.append((np.column_stack([state[0], q[:, :-1]]).T, reading.T, u.T))
        _check(loop, reading.T[: len(block[0])], commands.position, start)
        state = [q[:, -1], v[:, -1], reading[:, -1]]
    return Trajectory(*(np.concatenate(parts)[:n] for parts in zip(*chunks, strict=True)))


def _check(loop: ClosedLoop, reading: FloatArray, position: FloatArray, start: int) -> None:
    reference = position[start : start + len(reading)]
    lower, upper = loop.limits.T
    held = (np.abs(reading - reference) < LOST) & (reading >= lower) & (reading <= upper)
    if np.all(held):
        return
    sample, motor = np.argwhere(~held)[0]
    raise DataError(
        f"{loop.inputs[motor]} is lost {(start + sample) / loop.rate_hz:.3g} s after the start: it is at "
        f"{reading[sample, motor]:.3g} rad, should be at {reference[sample, motor]:.3g} rad and may be within "
        f"[{lower[motor]:.3g}, {upper[motor]:.3g}] rad"
    )


def _counted(angle: ca.SX, resolution: FloatArray) -> ca.SX:
    widths = enumerate(resolution)
    return ca.vertcat(*(width * ca.floor(angle[i] / width + 0.5) if width > 0 else angle[i] for i, width in widths))
