"""Whether the motion of a measurement, which moves the robot out of its postures, biases a linkage: three amplitudes.

    python scripts/studies/motion_amplitude.py [--quick]

An outside rig: the planar linkage of configs/robots/linkage_arm.yml without dry friction, written by hand for MuJoCo,
with its own equations and its own Runge-Kutta steps, the rod a tendon with a spring, under a sampled PD controller with
the torque held. Two motor angles and two gyroscopes are logged with noise, at 0.4, 1 and 1.6 times 0.007 and 0.014 rad
rms. The same records are fitted with what is known of their motion and without. Biases are means over data sets, in
standard deviations that the fit states; and those of all stiffnesses are to be within 2.
The last line is one JSON object with the table.

Three sets each, at 0.0056, 0.014 and 0.022 rad rms: k_rod -1.0, -4.7 and -4.8 standard deviations with the effect left
in, -0.1, -0.3 and -0.3 with it taken out; every other stiffness within 1.5 and within 0.6.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import importlib.util
import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.identify import fit_parameters
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Record
from elastid.response import FrequencyResponse
from elastid.robot import Robot
from elastid.study import load_robot

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "linkage_arm.yml"
TRUTH = {"k_2": 7e5, "k_3": 4.2e5, "k_rod": 1.3e7, "k_b2": 1.6e6, "d_2": 400.0, "d_3": 250.0, "d_rod": 5000.0}
POSTURES = {"c1": (0, 0), "c2": (0.5, -0.1), "c3": (-0.4, 0.4), "c4": (0.2, 0.9), "c5": (0.6, -0.2), "c6": (-0.3, -0.8)}
OUTPUTS = ("motor 2", "motor 3", "body lower_end y", "body upper y")
AMPLITUDES = (0.4, 1.0, 1.6)
TORQUE = 900.0  # Nm rms, at amplitude 1
KP, KD = np.array([6600.0, 3300.0]), np.array([1130.0, 560.0])
TORQUE_STD, ANGLE_STD, RATE_STD = 10.0, 1e-5, 1e-3
RATE_HZ, STEPS = 1000.0, 4  # the integrator takes so many steps in a sample
QUANTITIES = ("position", "position", "velocity", "velocity")
MIN_LEFT_IN, MAX_TAKEN = 2.5, 2.0  # standard deviations of the worst stiffness, at the largest motion and at all
MASS = 6.2  # of the rod, which MuJoCo has as two point masses
CENTER = 0.52
LENGTH = 0.89


def _inertial(place: str, mass: float, inertia: str) -> str:
    return f'<inertial pos="{place}" mass="{mass}" diaginertia="{inertia}"/>'


def _gear(name: str) -> str:
    """A spring between motor and joint."""
    k, d = TRUTH[f"k_{name}"], TRUTH[f"d_{name}"]
    ends = f'<joint joint="m{name}" coef="1"/><joint joint="q{name}" coef="-1"/>'
    return f'<fixed stiffness="{k}" damping="{d}" springlength="0">{ends}</fixed>'


POINT = "1e-9 1e-9 1e-9"
# Motors stand for themselves, with the inertia and the friction of the link side; tendons are springs.
MODEL = f"""<mujoco><compiler angle="radian"/>
<option timestep="{1e-3 / STEPS}" integrator="RK4" gravity="0 0 -9.81"/>
<worldbody>
 <body><joint name="m2" axis="0 1 0" damping="20"/>{_inertial("0 0 0", 1, "25 25 25")}</body>
 <body><joint name="m3" axis="0 1 0" damping="20"/>{_inertial("0 0 0", 1, "20 20 20")}</body>
 <body><joint name="q2" axis="0 1 0"/>{_inertial("0.06 0.088 0.2", 15, "0.4 0.4 0.1")}
  <body pos="0 0 0.445"><joint name="b2" axis="0 1 0" stiffness="{TRUTH["k_b2"]}" damping="400"/>
   {_inertial("0.06 0.088 0.2", 16, "0.4 0.4 0.1")}
   <body pos="0 0 0.445"><joint name="elbow" axis="0 1 0"/>{_inertial("0.35 0.13 0.14", 50, "1 5 5")}
    <body pos="-0.3 0 0">{_inertial("0 0 0", MASS * CENTER, POINT)}<site name="C"/></body>
   </body></body></body>
 <body><joint name="q3" axis="0 1 0"/>{_inertial("-0.4563 -0.0964 0.0311", 19.392, "0.2234 0.6895 0.6466")}
  <body pos="-0.3 0 0">{_inertial("0 0 0", MASS * (1 - CENTER), POINT)}<site name="B"/></body></body>
</worldbody>
<tendon>{_gear("2")}{_gear("3")}
 <spatial stiffness="{TRUTH["k_rod"]}" damping="{TRUTH["d_rod"]}" springlength="{LENGTH}">
  <site site="B"/><site site="C"/></spatial>
</tendon></mujoco>"""


def robot() -> Robot:
    """The robot of the file without dry friction, with a rod that is two point masses."""
    read = load_robot(ROBOT)
    (loop,) = read.loops
    assert loop.rod is not None
    rod = replace(loop.rod, inertia=MASS * CENTER * (1 - CENTER) * LENGTH**2)
    bodies = tuple(
        replace(
            body,
            joints=tuple(
                j if j.motor is None else replace(j, motor=replace(j.motor, coulomb=0.0)) for j in body.joints
            ),
        )
        for body in read.bodies
    )
    return replace(read, bodies=bodies, loops=(replace(loop, rod=rod),))


def moved(
    posture: tuple[float, float], injected: FloatArray, periods: int, seed: tuple[int, ...]
) -> tuple[FloatArray, FloatArray]:
    """Logs u (n, 2) and y (n, 4) of the last `periods` after one, of torques (N, 2) injected over and over."""
    import mujoco  # of the group `oracles`

    model = mujoco.MjModel.from_xml_string(MODEL)
    data, draw = mujoco.MjData(model), np.random.default_rng(seed)
    at = {model.joint(i).name: model.jnt_qposadr[i] for i in range(model.njnt)}
    motors, driven, chain = [at["m2"], at["m3"]], [at["q2"], at["q3"]], [at["q2"], at["b2"], at["elbow"]]
    data.qpos[motors], data.qpos[driven], data.qpos[at["elbow"]] = posture, posture, posture[1] - posture[0]
    # The gravity of the rigid arm, by virtual work: the elbow keeps the upper arm parallel to the crank.
    mujoco.mj_forward(model, data)
    weight = data.qfrc_bias[driven] + np.array([-1, 1]) * data.qfrc_bias[at["elbow"]]
    data.qpos[driven] -= weight / np.array([TRUTH["k_2"], TRUTH["k_3"]])
    data.qpos[at["elbow"]] = data.qpos[at["q3"]] - data.qpos[at["q2"]]
    before, n = np.array(posture, dtype=float), (periods + 1) * len(injected)
    u, y = np.empty((n, 2)), np.empty((n, 4))
    noise = draw.normal(size=(n, 6)) * [TORQUE_STD, TORQUE_STD, ANGLE_STD, ANGLE_STD, RATE_STD, RATE_STD]
    for k in range(n):
        reading, rates = data.qpos[motors] + noise[k, 2:4], np.cumsum(data.qvel[chain])[1:]
        u[k] = injected[k % len(injected)] + weight + KP * (posture - reading) - KD * (reading - before) * RATE_HZ
        y[k, :2], y[k, 2:], before = reading, rates + noise[k, 4:], reading
        data.qfrc_applied[motors] = u[k]
        mujoco.mj_step(model, data, nstep=STEPS)
    return (u + noise[:, :2])[len(injected) :], y[len(injected) :]


def plan_of(amplitude: float, realisations: int, seed: int, its: Robot) -> Plan:
    """The torques to inject."""
    rms = (amplitude * TORQUE, amplitude * TORQUE)
    excitation = MultisineSpec(rate_hz=RATE_HZ, period=2.0, band_hz=(2.0, 120.0), grid="odd-quasi-log", torque_rms=rms)
    postures = {name: tuple(map(float, posture)) for name, posture in POSTURES.items()}
    experiment = ExperimentSpec(configurations=postures, realisations=realisations, simulated=SimulatedSpec())
    return make_plan(excitation, experiment, its, seed)


def measured(plan: Plan, seed: int) -> tuple[FrequencyResponse, ...]:
    """The responses of all postures."""
    responses = []
    for q, configuration in enumerate(plan.configurations):
        records = []
        for e in (e for e in plan.experiments if e.configuration.name == configuration.name):
            r = plan.torque(e)
            u, y = moved(POSTURES[configuration.name], r, plan.periods, (seed, q, e.realisation, e.experiment))
            run = e.name, configuration, e.realisation, e.experiment, RATE_HZ, len(r), plan.inputs, OUTPUTS, QUANTITIES
            records.append(Record(*run, u, y, np.tile(r, (plan.periods, 1)), hold="zero-order"))
        responses.append(estimate(records, EstimatorSpec(friction="none"), plan.lines))
    return tuple(responses)


def errors(amplitude: float, realisations: int, seed: int) -> tuple[list[dict[str, float]], float]:
    """Errors in standard deviations without and with the effect of the motion, and the largest rms motion."""
    its = robot()
    responses = measured(plan_of(amplitude, realisations, seed, its), seed)
    spec = FitSpec(parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}, starts=1)
    rows = []
    for data in ([replace(G, motion=None) for G in responses], responses):
        result = fit_parameters(data, its, spec)
        std = dict(zip(result.parameters.free_names, np.sqrt(np.diag(result.covariance)), strict=True))
        theta = dict(zip(result.parameters.names, result.theta, strict=True))
        rows.append({name: float(np.log(theta[name] / true) / std[name]) for name, true in TRUTH.items()})
    return rows, max(float(G.motion.rms.max()) for G in responses if G.motion is not None)


def main() -> None:
    """The table and its JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the largest motion only, one data set")
    parser.add_argument("--sets", type=int, default=3, help="data sets of each amplitude")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    if importlib.util.find_spec("mujoco") is None:
        print(json.dumps({"skipped": "MuJoCo, the outside rig, is not installed"}))
        return
    amplitudes, sets = (AMPLITUDES[-1:], 1) if arguments.quick else (AMPLITUDES, arguments.sets)
    table = []
    print(f"{'motion, rad':<13}{'effect':<9}" + "".join(f"{name:>8}" for name in TRUTH))
    for amplitude in amplitudes:
        drawn = [errors(amplitude, 2 if arguments.quick else 3, arguments.seed + i) for i in range(sets)]
        for place, words in enumerate(("left in", "taken")):
            mean = {name: float(np.mean([rows[place][name] for rows, _ in drawn])) for name in TRUTH}
            table.append({"amplitude": amplitude, "rms": drawn[0][1], "effect": words, "bias_std": mean})
            print(f"{drawn[0][1]:<13.4f}{words:<9}" + "".join(f"{value:>8.2f}" for value in mean.values()), flush=True)
    stiffness = [name for name in TRUTH if name.startswith("k_")]
    worst = {
        words: [max(abs(row["bias_std"][name]) for name in stiffness) for row in table if row["effect"] == words]
        for words in ("left in", "taken")
    }
    assert worst["left in"][-1] > MIN_LEFT_IN, worst
    assert max(worst["taken"]) < MAX_TAKEN, worst
    print(json.dumps({"table": table, "worst_stiffness": worst}))


if __name__ == "__main__":
    main()
