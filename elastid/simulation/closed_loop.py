r"""Plant, friction, joint controller and encoders over time: a sampled loop around a continuous robot.

In every sample the controller reads the encoders, computes a torque and holds it until the next sample; the plant is
integrated in between. All noise comes in as signals, drawn before: the same commands give the same motion.

.. math:: (q, v, z, w, I, y)_{k+1}, u_k = F\bigl((q, v, z, w, I, y)_k, \text{references}_k, \text{noise}_k\bigr)

q, v: coordinates and velocities, z: states of friction, w: of the drives, I: of the integral, y: last reading. Each
stage of a Runge-Kutta step calls the same functions, so that the code of a robot's equations is there once.

Long simulations run as machine code, made by the C compiler of the machine in a temporary folder: the operations of
CasADi's virtual machine in the same order, without contraction into fused multiply-adds and without the compiler's own
arithmetic of pow, sin and cos, so that results are the same bit for bit. Nothing is left on the disk.
"""

import logging
import os
import platform
import shlex
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.model.elastic import ElasticModel
from elastid.record import JointLoop
from elastid.simulation.contacts import Contacts
from elastid.simulation.controller import Filters
from elastid.simulation.drives import Drives, gear_forces
from elastid.simulation.dynamics import free_acceleration, projection
from elastid.simulation.runge_kutta import FIFTH_ORDER, runge_kutta_step

# Of the optimisations beyond the first level only loops pay: the equations are one long line of operations, which takes
# the compiler half as long. Without the third option, calls of the C library meet vector registers in a state in which
# they take four times as long.
FLAGS = ["-O1", "-ftree-loop-vectorize", "-fexpensive-optimizations", "-shared", "-fPIC", "-ffp-contract=off"]
FLAGS += ["-fno-builtin"]
# Instructions with three operands take a sixth less time, and calls that are inlined or direct a fifteenth; compilers
# for other processors do not all know these options.
if platform.machine() in ("x86_64", "AMD64"):
    FLAGS += ["-march=native", "-fno-semantic-interposition", "-fno-plt"]
MAX_COMPILE_S = 60.0
# Calls that save as much time as compiling takes.
MIN_CALLS = 20_000

_log = logging.getLogger(__name__)


def compile_function(function: ca.Function, calls: int) -> ca.Function:
    """Return the function as machine code if at least MIN_CALLS calls are announced, otherwise itself."""
    if calls < MIN_CALLS:
        return function
    try:
        return _load(function)
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        _log.warning(
            "%s is interpreted, with the same results in more than ten times the time, because it cannot be compiled: "
            "%s; name a C compiler by CC, or leave out experiment.simulated.compiled in a simulation",
            function.name(),
            error,
        )
        return function


def compiler() -> list[str]:
    """Return command of the C compiler: $CC, otherwise cc, gcc or clang; raise OSError without one."""
    try:
        command = shlex.split(os.environ.get("CC", ""), posix=os.name != "nt")
    except ValueError as error:
        raise OSError(f"CC={os.environ['CC']} is no command: {error}") from None
    for name, *words in [command] if command else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(name)
        if path:
            return [path, *words]
    raise OSError(f"there is no C compiler ({command[0] if command else 'cc, gcc, clang'})")


def _load(function: ca.Function) -> ca.Function:
    """Load the function from a library, then remove it; OSError, RuntimeError or SubprocessError where that fails."""
    generator = ca.CodeGenerator(f"{function.name()}.c")
    generator.add(function)
    # Windows removes no library that is loaded.
    with tempfile.TemporaryDirectory(prefix="elastid-", ignore_cleanup_errors=True) as folder:
        source, library, output = (Path(folder, name) for name in ("function.c", "function.so", "output"))
        source.write_text(generator.dump(), encoding="utf-8")
        command = [*compiler(), *FLAGS, str(source), "-o", str(library), "-lm"]
        with output.open("wb") as file:  # a pipe would stay open with a child of the compiler that never ends
            process = subprocess.run(command, stdout=file, stderr=file, timeout=MAX_COMPILE_S, cwd=folder, check=False)
        if process.returncode:
            message = output.read_text(encoding="utf-8", errors="replace").strip()[-300:]
            raise OSError(f"{command[0]} ended with status {process.returncode} {message}".rstrip())
        return ca.external(function.name(), str(library))


def sampled_step(
    model: ElasticModel, contacts: Contacts, rate_hz: float, substeps: int, drives: Drives, has_theta: bool = False,
    filters: Filters | None = None,
) -> ca.Function:  # fmt: skip
    """Build (states, references, noise, gains, friction's numbers) -> the states one sample later, and u.

    substeps: Runge-Kutta steps in a sample.  The loops of a linkage are closed by projection after each sample.
    has_theta: theta (n_theta,) of the model is a last argument; otherwise its own numbers are inside.
    """
    sizes = {"q": model.n_q, "v": model.n_q, "z": contacts.n_states, "w": drives.n_states}
    sizes["x"] = 0 if filters is None else len(filters.matrices[0])
    sizes |= dict.fromkeys(("integral", "last", "position", "velocity", "torque", "disturbance", "noise"), model.n_u)
    sizes |= dict.fromkeys(("kp", "kd", "ki"), model.n_u) | {"curves": len(contacts.curves)}
    if has_theta:
        sizes["theta"] = len(model.theta)
    symbols = {name: ca.MX.sym(name, size) for name, size in sizes.items()}
    control, drive = _control(model, drives, rate_hz, filters), _drive(drives, 1 / (rate_hz * substeps))
    theta = ca.SX.sym("theta", len(model.theta)) if has_theta else None
    accelerate, advance = _acceleration(model, contacts, drives, theta), _advance(model, contacts)
    numbers = [symbols["theta"]] if has_theta else []

    def acceleration(q: ca.MX, v: ca.MX, z: ca.MX, torque: ca.MX) -> ca.MX:
        return accelerate(q, v, z, torque, symbols["disturbance"], symbols["curves"], *numbers)

    def advanced(z: ca.MX, v: ca.MX, step: float) -> ca.MX:
        return advance(z, v, symbols["curves"], step)

    reading, u, integral, x = control(*(symbols[name] for name in control.name_in()))
    q, v, z, w = (symbols[name] for name in ("q", "v", "z", "w"))
    for _ in range(substeps):
        *torques, w = drive(w, u)
        q, v, z = runge_kutta_step(acceleration, advanced, q, v, z, torques, 1 / (rate_hz * substeps), FIFTH_ORDER)
    if model.n_c:
        q, v = projection(model, theta)(q, v, *numbers)
    return ca.Function("sample", [*symbols.values()], [q, v, z, w, x, integral, reading, u])


def shafts(model: ElasticModel) -> tuple[ca.DM, ca.DM]:
    """Return E and its inverse: link side to shafts, where encoders count and drives clip (robot.mixing)."""
    E = model.robot.mixing
    return ca.sparsify(ca.DM(E)), ca.sparsify(ca.DM(np.linalg.inv(E)))


def _control(model: ElasticModel, drives: Drives, rate_hz: float, filters: Filters | None) -> ca.Function:
    """Build encoders and controller: reading, command u as the drives clip it, integral and filters' states after."""
    names = ("q", "x", "integral", "last", "position", "velocity", "torque", "noise", "kp", "kd", "ki")
    A, B, C, D = (np.zeros((0, 0)),) * 4 if filters is None else filters.matrices
    sizes = {"q": model.n_q, "x": len(A)}
    symbols = {name: ca.SX.sym(name, sizes.get(name, model.n_u)) for name in names}
    E, E_inverse = shafts(model)
    reading = E_inverse @ drives.reading(E @ ca.DM(model.B).T @ symbols["q"], symbols["noise"])
    last, position, velocity = symbols["last"], symbols["position"], symbols["velocity"]
    error = symbols["kp"] * (position - reading) + symbols["kd"] * (velocity - (reading - last) * rate_hz)
    command, x = symbols["torque"] + error + symbols["ki"] * symbols["integral"], symbols["x"]
    if filters is not None:
        feedback = error + symbols["ki"] * symbols["integral"]
        command, x = symbols["torque"] + ca.DM(C) @ x + ca.DM(D) @ feedback, ca.DM(A) @ x + ca.DM(B) @ feedback
    demand = E_inverse.T @ command
    output = drives.clipped(demand)
    u = command + E.T @ (output - demand)
    # A drive at its limit would wind the integral up.
    integral = symbols["integral"] + ca.if_else(output == demand, error / rate_hz, 0)
    results = [*map(ca.densify, (reading, u, integral, x))]
    return ca.Function("control", [*symbols.values()], results, [*names], ["reading", "u", "integral_after", "x_after"])


def _drive(drives: Drives, step: float) -> ca.Function:
    """Build (w, u) -> torque at each stage of a step, and w after it."""
    w, u = ca.SX.sym("w", drives.n_states), ca.SX.sym("u", len(drives.torque))
    torques, states = zip(*(drives.lagged(w, u, node * step) for node in FIFTH_ORDER.nodes), strict=True)
    return ca.Function("drive", [w, u], [*torques, states[-1]])


def _acceleration(model: ElasticModel, contacts: Contacts, drives: Drives, theta: ca.SX | None) -> ca.Function:
    """Build (q, v, z, torque, disturbance, curves) -> q'' with the drives' torque (n_u,), link side. theta:
    symbols, as a further argument.
    """
    (q, v), z = model.symbols("q", "v"), ca.SX.sym("z", contacts.n_states)
    torque, disturbance = ca.SX.sym("torque", model.n_u), ca.SX.sym("disturbance", model.n_u)
    curves = ca.SX.sym("curves", len(contacts.curves))
    B, (E, E_inverse) = ca.DM(model.B), shafts(model)
    driving = E.T @ drives.on_motors(E_inverse.T @ torque, E @ B.T @ q) + disturbance
    numbers = [] if theta is None else [theta]
    braking = contacts.torque(v, z, curves) + gear_forces(model, q, v, theta)
    a = free_acceleration(model, theta=theta)(q, v, B @ driving - braking, *numbers)
    return ca.Function("acceleration", [q, v, z, torque, disturbance, curves, *numbers], [ca.densify(a)], {"cse": True})


def _advance(model: ElasticModel, contacts: Contacts) -> ca.Function:
    """Build (z, v, curves, step) -> the states of friction after `step` s at constant v."""
    z, v = ca.SX.sym("z", contacts.n_states), ca.SX.sym("v", model.n_q)
    curves, step = ca.SX.sym("curves", len(contacts.curves)), ca.SX.sym("step")
    return ca.Function("advance", [z, v, curves, step], [ca.densify(contacts.advanced(v, z, curves, step))])


# Samples between two checks of the result: some milliseconds of computing, so that Ctrl-C is heard.  A power of four.
CHUNK_SAMPLES = 256
_FILTERS = 4  # place of the filters' states among the arguments


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
        for field in fields(self):
            shape = getattr(self, field.name).shape
            if shape != self.position.shape:
                raise ValueError(f"{field.name} has shape {shape}, position {self.position.shape}")


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
    model: ElasticModel, contacts: Contacts, limits: FloatArray, rate_hz: float, substeps: int, drives: Drives,
    samples: int = 0, has_theta: bool = False, filters: Filters | None = None,
) -> ClosedLoop:  # fmt: skip
    """Close the loop around a model with its friction and its drives.

    substeps: Runge-Kutta steps in a sample.  samples: about how many will be simulated by a compiled step, 0 by an
    interpreted one.  has_theta: each run has numbers theta of the model of its own.  filters: of the feedback.
    """
    sample = sampled_step(model, contacts, rate_hz, substeps, drives, has_theta, filters)
    # Seven results of a sample start the next: q, v, states of friction, drives and filters, integral, last reading. A
    # chunk is four times four times ... a sample, which CasADi builds sooner than ten times ten times ..., its default.
    function = compile_function(sample.mapaccum("closed_loop", CHUNK_SAMPLES, 7, {"base": 4}), samples)
    units = tuple(joint.unit for joint in model.robot.driven)
    return ClosedLoop(model.inputs, units, limits, model.B, rate_hz, contacts, drives, function)


def simulate(
    loop: ClosedLoop, gains: JointLoop, commands: Commands, q0: FloatArray, curves: FloatArray | None = None,
    v0: FloatArray | None = None, theta: FloatArray | None = None,
) -> Trajectory:  # fmt: skip
    """Run the loop from q0 (n_q,) over the n samples of the commands.

    v0 (n_q,): at the start, where friction has slid so for long; at rest by default.
    curves (n, 9 n_f) or (9 n_f,): the friction's numbers, by default those without load at the reference temperature.
    theta (n_theta,): numbers of the model, of a loop `has_theta`.
    Raises DataError where a motor leaves its limits or is lost.
    """
    n, n_u = commands.position.shape
    numbers = loop.contacts.curves if curves is None else curves
    signals = [getattr(commands, field.name) for field in fields(commands)]
    signals += [np.broadcast_to(gain, (n, n_u)) for gain in (gains.kp, gains.kd, gains.ki)]
    signals.append(np.broadcast_to(numbers, (n, numbers.shape[-1])))
    signals += [] if theta is None else [np.broadcast_to(theta, (n, len(theta)))]
    v = np.zeros(len(q0)) if v0 is None else v0
    z = loop.contacts.steady(v, np.atleast_2d(numbers)[0])
    state = [q0, v, z, loop.drives.start(commands.torque[0]), np.zeros(loop.function.size1_in(_FILTERS))]
    state += [np.zeros(n_u), loop.B.T @ (q0 - v / loop.rate_hz)]
    state = [np.array(values, np.float64) for values in state]
    blocks = [np.empty((CHUNK_SAMPLES, signal.shape[1])) for signal in signals]
    results = [np.empty((CHUNK_SAMPLES, loop.function.size1_out(i))) for i in range(loop.function.n_out())]
    # Matrices of CasADi made of these and back would take as long as the simulation.  Its columns are rows here.
    buffer: Any  # its type stub requires a size; deleted at the end of the scope
    buffer, evaluate = loop.function.buffer()
    for i, values in enumerate((*state, *blocks)):
        buffer.set_arg(i, values.data)
    for i, values in enumerate(results):
        buffer.set_res(i, values.data)
    chunks = []
    for start in range(0, n, CHUNK_SAMPLES):
        count = min(CHUNK_SAMPLES, n - start)
        for block, signal in zip(blocks, signals, strict=True):
            block[:count] = signal[start : start + count]
            block[count:] = block[count - 1]
        evaluate()
        q, reading, u = (results[i][:count].copy() for i in (0, -2, -1))
        chunks.append((np.vstack([state[0], q[:-1]]), reading, u))
        _check(loop, reading, commands.position, start)
        for values, result in zip(state, results, strict=False):
            values[:] = result[-1]
    return Trajectory(*map(np.concatenate, zip(*chunks, strict=True)))


def _check(loop: ClosedLoop, reading: FloatArray, position: FloatArray, start: int) -> None:
    reference = position[start : start + len(reading)]
    lower, upper = loop.limits.T
    # One turn on the link side from its reference (or as much in m): lost.
    within = (np.abs(reading - reference) < 2 * np.pi) & (reading >= lower) & (reading <= upper)
    if np.all(within):
        return
    sample, motor = np.argwhere(~within)[0]
    unit = loop.units[motor]
    is_free = np.isinf(lower[motor]) and np.isinf(upper[motor])
    may = "" if is_free else f", limits [{lower[motor]:.3g}, {upper[motor]:.3g}] {unit}"
    raise DataError(
        "experiment/diverged",
        f"{loop.inputs[motor]} does not follow its reference {(start + sample) / loop.rate_hz:.3g} s after the start: "
        f"{reading[sample, motor]:.3g} instead of {reference[sample, motor]:.3g} {unit}{may}",
    )
