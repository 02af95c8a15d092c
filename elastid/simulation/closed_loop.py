"""Plant, friction, joint controller and encoders over time: a sampled loop around a continuous robot.

In every sample the controller reads the encoders, computes a torque and holds it until the next sample; the plant is
integrated in between. All noise comes in as signals, drawn before: the same commands give the same motion.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.model.elastic import ElasticModel
from elastid.simulation.baumgarte import projection
from elastid.simulation.controller import Gains, feedback
from elastid.simulation.drives import Drives
from elastid.simulation.dynamics import free_acceleration, runge_kutta_step
from elastid.simulation.friction_states import Contacts
from elastid.simulation.spec import StabilisationSpec

# Samples between two checks of the result: a few hundredths of a second of computing, so that Ctrl-C is heard.
CHUNK_SAMPLES = 1000

# Results of a sample that the next one starts from: q, v, states of friction and drives, integral, last reading.
N_STATES = 6

# rad (or m) on the link side: a motor this far from its reference is lost.
MAX_TRACKING_ERROR = 2 * np.pi

# The loops of a linkage closed by projection alone.
PROJECTED = StabilisationSpec()


@frozen_value(eq=False)
class Commands:
    """Inputs of the loop, each (n, n_u), link side: rad, rad/s, Nm; m, m/s, N where a joint slides.

    position, velocity: reference.  torque: feed-forward and injection.  disturbance: torque that is not in
    the log.  reading_noise: added to the motor angle before the encoder counts it.
    """

    position: FloatArray
    velocity: FloatArray
    torque: FloatArray
    disturbance: FloatArray
    reading_noise: FloatArray

    def __post_init__(self) -> None:
        """Check the shapes."""
        for each in fields(self):
            if getattr(self, each.name).shape != self.position.shape:
                raise ValueError(
                    f"{each.name} has shape {getattr(self, each.name).shape}, position {self.position.shape}"
                )


@dataclass(frozen=True)
class Trajectory:
    """Result at the sampling instants: q (n, n_q) true, reading (n, n_u) of the encoders, u (n, n_u) held.

    u: the controller's command as the drives clip it.
    """

    q: FloatArray
    reading: FloatArray
    u: FloatArray


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """A robot under its controller, ready to run: CHUNK_SAMPLES samples of it as one CasADi function.

    limits (n_u, 2): angles (rad, or m where a joint slides: units) that the motors may take, link side.
    """

    inputs: tuple[str, ...]
    units: tuple[str, ...]
    limits: FloatArray
    B: FloatArray
    rate_hz: float
    contacts: Contacts
    drives: Drives
    function: ca.Function


def closed_loop(
    model: ElasticModel,
    contacts: Contacts,
    limits: FloatArray,
    rate_hz: float,
    substeps: int,
    drives: Drives,
    loops: StabilisationSpec = PROJECTED,
) -> ClosedLoop:
    """Close the loop around a model with its friction and its drives.

    substeps: Runge-Kutta steps in a sample.  loops: stabilisation of the loops of a linkage.
    """
    names = {"q": model.n_q, "v": model.n_q, "z": contacts.n_states, "w": drives.n_states}
    names |= dict.fromkeys(("integral", "last", "position", "velocity", "torque", "disturbance", "noise"), model.n_u)
    names |= dict.fromkeys(("kp", "kd", "ki"), model.n_u) | {"curves": len(contacts.curves)}
    given = {name: ca.SX.sym(name, size) for name, size in names.items()}
    q, v, z, w = (given[name] for name in ("q", "v", "z", "w"))
    E, E_inverse = _shafts(model)
    reading = E_inverse @ drives.reading(E @ ca.DM(model.B).T @ q, given["noise"])
    last, position, velocity = given["last"], given["position"], given["velocity"]
    error = feedback(reading, last, position, velocity, given["kp"], given["kd"], rate_hz)
    command = given["torque"] + error + given["ki"] * given["integral"]
    asked = E_inverse.T @ command
    taken = drives.clipped(asked)
    u = command + E.T @ (taken - asked)
    # A drive at its limit would wind the integral up.
    integral = given["integral"] + ca.if_else(taken == asked, error / rate_hz, 0)
    free = free_acceleration(model, loops.alpha, loops.beta)
    q, v, z, w = _moved(model, free, contacts, drives, (q, v, z, w), u, given, 1 / (rate_hz * substeps), substeps)
    if model.n_c and loops.project:
        q, v = projection(model)(q, v)
    results = [q, v, z, w, integral, reading, u]
    units = tuple(joint.unit for joint in model.robot.driven)
    sample = ca.Function("sample", list(given.values()), results)
    function = sample.mapaccum("closed_loop", CHUNK_SAMPLES, N_STATES, {})
    return ClosedLoop(model.inputs, units, limits, model.B, rate_hz, contacts, drives, function)


def _moved(
    model: ElasticModel,
    free: ca.Function,
    contacts: Contacts,
    drives: Drives,
    state: tuple[ca.SX, ca.SX, ca.SX, ca.SX],
    u: ca.SX,
    given: dict[str, ca.SX],
    step: float,
    steps: int,
) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """(q, v, z, w) after the steps of a sample in which the command u is held."""
    B, curves = ca.DM(model.B), given["curves"]
    E, E_inverse = _shafts(model)

    def acceleration(q: ca.SX, v: ca.SX, z: ca.SX, torque: ca.SX) -> ca.SX:
        driving = E.T @ drives.on_motors(E_inverse.T @ torque, E @ B.T @ q) + given["disturbance"]
        return free(q, v, B @ driving - contacts.torque(v, z, curves))

    def advanced(z: ca.SX, v: ca.SX, step: float) -> ca.SX:
        return contacts.advanced(v, z, curves, step)

    q, v, z, w = state
    for _ in range(steps):
        torques = [drives.lagged(w, u, part * step) for part in (0.0, 0.5, 1.0)]
        q, v, z = runge_kutta_step(acceleration, advanced, q, v, z, [torque for torque, _ in torques], step)
        w = torques[-1][1]
    return q, v, z, w


def _shafts(model: ElasticModel) -> tuple[ca.DM, ca.DM]:
    """E and its inverse: from the link side to the shafts, where encoders count and drives clip (robot.mixing)."""
    E = model.robot.mixing
    return ca.sparsify(ca.DM(E)), ca.sparsify(ca.DM(np.linalg.inv(E)))


def simulate(
    loop: ClosedLoop, gains: Gains, commands: Commands, q0: FloatArray, curves: FloatArray | None = None
) -> Trajectory:
    """Run the loop from rest in q0 (n_q,) over the n samples of the commands.

    curves (n, 9 n_f) or (9 n_f,): the friction's numbers, by default those without load at the reference temperature.
    Raises DataError where a motor leaves its limits or is lost.
    """
    n, n_u = commands.position.shape
    numbers = loop.contacts.curves if curves is None else curves
    signals = [getattr(commands, field.name) for field in fields(commands)]
    signals += [np.broadcast_to(gain, (n, n_u)) for gain in (gains.kp, gains.kd, gains.ki)]
    signals.append(np.broadcast_to(numbers, (n, numbers.shape[-1])))
    z = np.zeros(loop.contacts.n_states)
    state = [q0, np.zeros(len(q0)), z, loop.drives.start(commands.torque[0]), np.zeros(n_u), loop.B.T @ q0]
    chunks = []
    for start in range(0, n, CHUNK_SAMPLES):
        block = [signal[start : start + CHUNK_SAMPLES] for signal in signals]
        padding = ((0, CHUNK_SAMPLES - len(block[0])), (0, 0))
        results = [
            np.array(result.full())
            for result in loop.function(*state, *(np.pad(part, padding, mode="edge").T for part in block))
        ]
        q, reading, u = results[0], *results[-2:]
        chunks.append((np.column_stack([state[0], q[:, :-1]]).T, reading.T, u.T))
        _check(loop, reading.T[: len(block[0])], commands.position, start)
        state = [result[:, -1] for result in results[:N_STATES]]
    return Trajectory(*(np.concatenate(parts)[:n] for parts in zip(*chunks, strict=True)))


def _check(loop: ClosedLoop, reading: FloatArray, position: FloatArray, start: int) -> None:
    reference = position[start : start + len(reading)]
    lower, upper = loop.limits.T
    held = (np.abs(reading - reference) < MAX_TRACKING_ERROR) & (reading >= lower) & (reading <= upper)
    if np.all(held):
        return
    sample, motor = np.argwhere(~held)[0]
    unit = loop.units[motor]
    raise DataError(
        f"{loop.inputs[motor]} is lost {(start + sample) / loop.rate_hz:.3g} s after the start: it is at "
        f"{reading[sample, motor]:.3g} {unit}, should be at {reference[sample, motor]:.3g} {unit} and may be within "
        f"[{lower[motor]:.3g}, {upper[motor]:.3g}] {unit}"
    )
