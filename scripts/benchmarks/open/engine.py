"""The robots in MuJoCo: friction of motors and gears, transmission errors, sampled controllers, encoders and logs."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from robots import ACCELERATION, STEPS_HZ, Array, Robot, Row, mjcf
from scipy.optimize import root

PERIOD_S, PERIODS, COUNTS = 2.0, 3, 2**17  # of a period; logged behind one that settles; of the encoder, per turn
RATES_HZ = {"torque": 500, "position": 250, "command": 500}  # of the logs
LINES = np.arange(5, 121, 2)  # odd multiples of 0.5 Hz, up to 60 Hz
SLIP = 2e-4  # rad/s, above which the friction of a motor without presliding is that of sliding


class Plant:
    """A robot in the engine; indices of motors and of the twists of their gears among the coordinates."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self.model = robot, mujoco.MjModel.from_xml_string(mjcf(robot))
        dofs = ([self.model.joint(f"{kind}{j.name}").dofadr[0] for j in robot.gears] for kind in "ms")
        self.motors, self.twists = map(np.array, dofs)


def physics(plant: Plant) -> tuple[Callable[..., Any] | None, ...]:
    """Return callbacks for MuJoCo: motor friction, presliding, hysteresis of gears and transmission errors.

    A bristle has z' = v - |v| z / z_s and the torque F z / z_s + damping z'; without a presliding distance the
    torque is F tanh(v / v_s). Hysteresis of a gear is the same law of its twist. With a transmission error e(theta) the
    gear twists by s - e: V = k (s - e)^2 / 2 pulls both sides.
    """
    gears = plant.robot.gears
    sliding = np.array([0.0 if j.motor.z else j.motor.F for j in gears])
    bristles = [(plant.model.joint(name).dofadr[0], *numbers) for name, *numbers in plant.robot.bristles]
    errors = [gear for gear in zip(plant.motors, plant.twists, gears, strict=True) if gear[2].error]

    def rate(_: Any, data: Any, index: int) -> float:
        dof, _, z_s, _ = bristles[index]
        v = data.qvel[dof]
        return float(v - abs(v) * data.act[index] / z_s)

    def passive(model: Any, data: Any) -> None:
        force, v, q = data.qfrc_passive, data.qvel, data.qpos
        force[plant.motors] -= sliding * np.tanh(v[plant.motors] / SLIP)
        for index, (dof, torque, z_s, loss) in enumerate(bristles):
            force[dof] -= torque * data.act[index] / z_s + (loss * rate(model, data, index) if loss else 0.0)
        for motor, twist, j in errors:
            turns = j.order * j.motor.ratio
            angle = turns * q[motor] + j.phase
            e, slope = j.error * math.sin(angle), j.error * turns * math.cos(angle)
            speed = slope * v[motor]
            force[motor] += (j.k * (q[twist] - e) + j.d * (v[twist] - speed)) * slope
            force[twist] += j.k * e + j.d * speed

    return passive if sliding.any() or bristles or errors else None, rate if bristles else None


def equilibrium(plant: Plant, posture: Array, data: Any) -> Array:
    """Set the state to the equilibrium with motors at the posture. Return the motor torques (n,), Nm."""
    passive = np.setdiff1d(np.arange(plant.model.nv), plant.motors)
    start = np.zeros(len(passive))
    if plant.robot.rod:
        start[passive == plant.model.joint("selbow").dofadr[0]] = posture[1] - posture[0]

    def balance(x: Array) -> Array:
        data.qvel[:], data.qpos[plant.motors], data.qpos[passive] = 0.0, posture, x
        mujoco.mj_forward(plant.model, data)
        return np.asarray(data.qfrc_bias - data.qfrc_passive)

    scale = 1 + np.abs(balance(start)).max()
    torque = balance(root(lambda x: balance(x)[passive] / scale, start, method="hybr", tol=1e-13).x)
    if np.abs(torque[passive]).max() > 1e-6 * scale:
        raise RuntimeError(f"{plant.robot.name}: no equilibrium at {posture}")
    return torque[plant.motors]


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


def closed_loop(
    plant: Plant, law: Controller, target: Array, feedforward: Array, disturbance: Array, count: Array
) -> tuple[Array, ...]:
    """Simulate the control cycles from rest: q_r, r and a disturbance torque (cycles, n), encoder counts (n,) in rad.

    Return u (cycles, n), encoder positions q (cycles, n), coordinates and speeds of the engine (cycles, n_v).
    """
    data, q_last, cycles, (passive, rate) = mujoco.MjData(plant.model), target[0], [], physics(plant)
    mujoco.set_mjcb_passive(passive)
    mujoco.set_mjcb_act_dyn(rate)
    try:
        hold = equilibrium(plant, target[0], data)
        for q_r, r, torque in zip(target, feedforward, disturbance, strict=True):
            q = np.round(data.qpos[plant.motors] / count) * count
            u = hold + law.kp * (q_r - q) - law.kd * (q - q_last) * law.hz + r
            cycles.append((u, q, data.qpos.copy(), data.qvel.copy()))
            data.qfrc_applied[plant.motors], q_last = u + torque, q
            mujoco.mj_step(plant.model, data, round(1 / law.hz / plant.model.opt.timestep))
    finally:
        mujoco.set_mjcb_passive(None)
        mujoco.set_mjcb_act_dyn(None)
    return tuple(map(np.array, zip(*cycles, strict=True)))


def simulate(
    row: Row, plant: Plant, law: Controller, posture: Array, phases: Array, torque: Array, rng: np.random.Generator
) -> dict[str, Array]:
    """Simulate one experiment with a multisine of complex phases (F, n). Return signals (samples, n) at the log rate.

    The amplitudes are torques, or references that would cause these torques in a rigid robot. The experiment starts at
    rest, and the signals include the settling period.
    """
    is_torque, cycle, slow = row.route == "torque", law.hz // RATES_HZ[row.route], 2 * np.pi / PERIOD_S
    ratio, k, d = np.array([(j.motor.ratio, j.k, j.d) for j in plant.robot.gears]).T
    ticks = np.arange(round((PERIODS + 1) * PERIOD_S * law.hz))
    amplitudes = phases * torque * np.sqrt(2 / len(LINES)) / (1.0 if is_torque else law.kp)
    wave = np.array([(np.exp(1j * slow * LINES * (tick / law.hz)) @ amplitudes).real for tick in ticks])
    target = posture + row.carrier * np.sin(slow * ticks[:, None] / law.hz + np.arange(len(posture)))
    r, feedforward = (wave, wave) if is_torque else (target + wave, np.zeros_like(wave))
    reference = target if is_torque else r[np.maximum(ticks - round(law.reference_delay * law.hz), 0)]
    if cycle > 1:  # linear between the references of two cycles, with a delay of one cycle
        begin, part = ticks - ticks % cycle, (ticks % cycle)[:, None]
        reference = (last := r[np.maximum(begin - cycle, 0)]) + (r[begin] - last) * part / cycle
    disturbance = 0.01 * torque * rng.standard_normal(wave.shape)
    u, q, x, v = closed_loop(plant, law, reference, feedforward, disturbance, 2 * np.pi / COUNTS / ratio)
    u, twist = u[np.maximum(ticks - round(law.torque_delay * law.hz), 0)], x[:, plant.twists]
    signals = r, u, q, -k * twist - d * v[:, plant.twists], x[:, plant.motors] + twist
    r, u, q, sensor, joint = (signal[::cycle] for signal in signals)
    noise = 0.005 * torque * rng.standard_normal((2, *u.shape))
    return {"r": r, "u": u + noise[0], "q": q * ratio, "sensor": sensor + noise[1], "joint": np.round(joint, 7)}
