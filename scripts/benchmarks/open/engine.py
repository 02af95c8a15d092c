"""The robots in MuJoCo: friction of motors and gears, transmission errors, sampled controllers, encoders and logs."""

import functools
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from robots import ACCELERATION, Array, Robot, Row, mjcf
from scipy.optimize import root

PERIOD_S, PERIODS, COUNTS = 2.0, 3, 2**17  # of a period; logged behind one that settles; of the encoder, per turn
RATES_HZ = {"torque": 500, "position": 250, "command": 500}  # of the logs
STEPS_HZ = 4000  # of the engine, and of the drives that follow position references
LINES = np.arange(5, 121, 2)  # odd multiples of 0.5 Hz, up to 60 Hz


@dataclass(frozen=True, eq=False)
class Plant:
    """A robot in the engine; indices of motors and of the twists of their gears among the coordinates."""

    robot: Robot
    model: Any
    motors: Array
    twists: Array


def build(robot: Robot) -> Plant:
    """Compile a robot."""
    model = mujoco.MjModel.from_xml_string(mjcf(robot, 1 / STEPS_HZ))
    names = [j.name for j in robot.joints if j.motor]
    motors, twists = (np.array([model.joint(f"{kind}{name}").dofadr[0] for name in names]) for kind in "ms")
    return Plant(robot, model, motors, twists)


@contextmanager
def physics(plant: Plant) -> Iterator[None]:
    """Add motor friction, presliding, hysteresis of gears and transmission errors to MuJoCo.

    A bristle has z' = v - |v| z / z_s and the torque F z / z_s + damping z'; without a presliding distance the
    torque is F tanh(v / v_s). Hysteresis of a gear is the same law of its twist. With a transmission error e(theta) the
    gear twists by s - e: V = k (s - e)^2 / 2 pulls both sides.
    """
    gears = [j for j in plant.robot.joints if j.motor]
    F, z, damping = (np.array([getattr(j.motor, name) for j in gears]) for name in ("F", "z", "damping"))
    rubs = np.where(z > 0, 0.0, F)
    v_s = 2e-4 * np.maximum(1.0, rubs.max(initial=0.0) > 0)
    bristles = [(int(plant.motors[i]), F[i], z[i], damping[i]) for i in np.flatnonzero(z)]
    bristles += [(int(t), j.hysteresis, j.knee, 0.0) for t, j in zip(plant.twists, gears, strict=True) if j.hysteresis]
    errors = [(int(m), int(t), j) for m, t, j in zip(plant.motors, plant.twists, gears, strict=True) if j.error]

    def rate(_: Any, data: Any, index: int) -> float:
        dof, _, z_s, _ = bristles[index]
        v = data.qvel[dof]
        return float(v - abs(v) * data.act[index] / z_s)

    def passive(model: Any, data: Any) -> None:
        force, v, q = data.qfrc_passive, data.qvel, data.qpos
        force[plant.motors] -= rubs * np.tanh(v[plant.motors] / v_s)
        for index, (dof, torque, z_s, loss) in enumerate(bristles):
            force[dof] -= torque * data.act[index] / z_s + (loss * rate(model, data, index) if loss else 0.0)
        for motor, twist, j in errors:
            turns = j.order * j.motor.ratio
            angle = turns * q[motor] + j.phase
            e, slope = j.error * math.sin(angle), j.error * turns * math.cos(angle)
            speed = slope * v[motor]
            torque = j.k * (q[twist] - e) + j.d * (v[twist] - speed)
            force[twist] += j.k * e + j.d * speed
            force[motor] += torque * slope

    mujoco.set_mjcb_passive(passive)
    mujoco.set_mjcb_act_dyn(rate if bristles else None)
    try:
        yield
    finally:
        mujoco.set_mjcb_passive(None)
        mujoco.set_mjcb_act_dyn(None)


def equilibrium(plant: Plant, posture: Array, data: Any) -> Array:
    """Set the state to the equilibrium with motors at the posture. Return the motor torques (n,), Nm."""
    passive = [i for i in range(plant.model.nv) if i not in plant.motors]
    start = np.zeros(len(passive))
    if plant.robot.rod:
        start[passive.index(int(plant.model.joint("selbow").dofadr[0]))] = posture[1] - posture[0]

    def balance(x: Array) -> Array:
        data.qvel[:], data.qpos[plant.motors], data.qpos[passive] = 0.0, posture, x
        mujoco.mj_forward(plant.model, data)
        return np.asarray(data.qfrc_bias - data.qfrc_passive)

    scale = 1 + np.abs(balance(start)).max()
    end = root(lambda x: balance(x)[passive] / scale, start, method="hybr", tol=1e-13)
    torque = balance(end.x)
    if np.abs(torque[passive]).max() > 1e-6 * scale:
        raise RuntimeError(f"{plant.robot.name}: no equilibrium at {posture}")
    return torque[plant.motors].copy()


def push(plant: Plant, data: Any, force: Array) -> None:
    """Apply a force (3,) at the tool."""
    site = data.site("tool")
    body = plant.model.site("tool").bodyid[0]
    data.qfrc_applied[:] = 0.0
    mujoco.mj_applyFT(plant.model, data, force, np.zeros(3), site.xpos, body, data.qfrc_applied)


@dataclass(frozen=True, eq=False)
class Controller:
    """u = hold + r + k_p (q_r - q) - k_d q', q' from two encoder positions; delays of references and logs in s."""

    kp: Array
    kd: Array
    hz: int
    reference_delay: float = 0.0
    torque_delay: float = 0.0


def controller(row: Row, torque: Array, rng: np.random.Generator) -> Controller:
    """Choose a PD controller of 2 Hz, for references of 3 Hz."""
    inertia = torque / ACCELERATION
    if row.route == "torque":
        return Controller(inertia * (2 * np.pi * 2) ** 2, 1.4 * inertia * 2 * np.pi * 2, 500)
    kd = inertia * 2 * np.pi * 3
    if row.route == "command":
        return Controller(kd * 15, kd, 500, reference_delay=float(rng.integers(0, 5)) / 500)
    return Controller(kd * 15, kd, STEPS_HZ, torque_delay=float(rng.integers(2, 24)) / STEPS_HZ)


def simulate(
    row: Row, plant: Plant, law: Controller, posture: Array, phases: Array, torque: Array, rng: np.random.Generator
) -> dict[str, Array]:
    """Simulate one experiment with a multisine of complex phases (F, n). Return signals (samples, n) at the log rate.

    The amplitudes are torques, or references that would cause these torques in a rigid robot. The experiment starts at
    rest, and the signals include the settling period.
    """
    data, motors, is_torque = mujoco.MjData(plant.model), plant.motors, row.route == "torque"
    ratio, k, d = np.array([(j.motor.ratio, j.k, j.d) for j in plant.robot.joints if j.motor]).T
    count, offset = 2 * np.pi / COUNTS / ratio, np.arange(len(posture))
    cycle, slow = law.hz // RATES_HZ[row.route], 2 * np.pi / PERIOD_S
    amplitudes = phases * torque * np.sqrt(2 / len(LINES)) / (1.0 if is_torque else law.kp)

    @functools.cache
    def wave(tick: int) -> Array:
        return np.asarray((np.exp(1j * slow * LINES * (max(tick, 0) / law.hz)) @ amplitudes).real)

    @functools.cache
    def target(tick: int) -> Array:
        """Return the reference position: posture plus slow motion, plus the multisine unless it is a torque."""
        carrier = row.carrier * np.sin(slow * max(tick, 0) / law.hz + offset)
        return posture + carrier + (0 if is_torque else wave(tick))

    def interpolated(tick: int) -> Array:
        """Interpolate linearly between the references of two cycles, with a delay of one cycle."""
        j, part = divmod(tick, cycle)
        last_target, next_target = target((j - 1) * cycle), target(j * cycle)
        return target(tick) if cycle == 1 else np.asarray(last_target + (next_target - last_target) * part / cycle)

    late, lag = round(law.reference_delay * law.hz), round(law.torque_delay * law.hz)
    logs, torques = [], []
    with physics(plant):
        hold, last_target = equilibrium(plant, target(0), data), target(0)
        for tick in range(round((PERIODS + 1) * PERIOD_S * law.hz)):
            q = np.round(data.qpos[motors] / count) * count
            u = hold + law.kp * (interpolated(tick - late) - q) - law.kd * (q - last_target) * law.hz
            torques.append(u + wave(tick) if is_torque else u)
            if tick % cycle == 0:
                twist, speed = data.qpos[plant.twists], data.qvel[plant.twists]
                r = wave(tick) if is_torque else target(tick)
                logs.append((r, torques[max(tick - lag, 0)], q, -k * twist - d * speed, data.qpos[motors] + twist))
            last_target = q
            data.qfrc_applied[motors] = torques[-1] + 0.01 * torque * rng.standard_normal(len(u))
            mujoco.mj_step(plant.model, data, STEPS_HZ // law.hz)
    r, u, q, sensor, joint = np.array(logs).transpose(1, 0, 2)
    noise = 0.005 * torque * rng.standard_normal((2, *u.shape))
    return {"r": r, "u": u + noise[0], "q": q * ratio, "sensor": sensor + noise[1], "joint": np.round(joint, 7)}
