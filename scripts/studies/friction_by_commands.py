"""Test of Coulomb friction from commands and positions alone, if MuJoCo simulates it as a soft constraint.

    python scripts/studies/friction_by_commands.py [--quick] [--losses 0.2 1 4] [--seed 0]

One hinge: inertia 0.15 kg m^2, damping 5 Nms/rad, frictionloss in Nm, a servo of 1000 Nm/rad and 100 Nms/rad, steps of
2 ms (implicitfast), commands in steps of 20 ms, 30 s at 500 Hz, encoder noise of 1e-5 rad (rms).  sines: six sines up
to 1.5 Hz; steps: of 0.05 to 0.15 rad every 1.2 s; rest: sines for 6 s, then no motion; forwards: 0.2 rad/s and a sine.
In `forwards` the joint never reverses, and only the sum of Coulomb friction and offset is identifiable.

Each row has estimates with standard deviations, and the rms of measured minus simulated positions, rad.  The
assertions: the error of Coulomb friction (forwards: of its sum with the offset) is below 1 %, and without steps below
3.5 standard deviations. With steps, the error is 0.1 to 0.3 %, which is up to 4.5 standard deviations.  The last line
is one JSON object.
"""

import json
import time

import study_run
import mujoco
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.friction_study.commanded import CommandedLog
from elastid.friction_study.commanded_fit import fit_commanded

KP, KD, RATE_HZ, SECONDS, NOISE_RAD = 1000.0, 100.0, 500.0, 30.0, 1e-5
JOINT = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
<inertial mass="1" pos="0 0 0" diaginertia=".05 .05 .05"/><joint name="j" armature=".1" damping="5" frictionloss="{}"/>
</body></worldbody><actuator><general joint="j" biastype="affine" gainprm="{}" biasprm="0 -{} -{}"/></actuator>
</mujoco>"""
MOTIONS = ("sines", "steps", "rest", "forwards")


def commands(motion: str, rng: np.random.Generator) -> FloatArray:
    """Return commanded positions (n,), rad, constant for 20 ms each."""
    t = np.repeat(np.arange(0.0, SECONDS, 0.02), 10)
    if motion == "steps":
        return 0.15 * np.array([0, 1, -0.6, 0.4, -1, 0.2, 0.8, -0.3])[(t // 1.2).astype(int) % 8]
    if motion == "forwards":
        return 0.2 * t + 0.015 * np.sin(np.pi * t)
    hz, phase = rng.uniform(0.1, 1.5, (6, 1)), rng.uniform(0, 2 * np.pi, (6, 1))
    moving = np.minimum(t, 6.0) if motion == "rest" else t
    return np.minimum(t / 2, 1) * 0.03 * np.sin(2 * np.pi * hz * moving + phase).sum(axis=0)


def simulate(loss: float, reference: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return encoder positions (n,), rad, of the hinge in MuJoCo under commanded positions (n,)."""
    model = mujoco.MjModel.from_xml_string(JOINT.format(loss, KP, KP, KD))
    data, q = mujoco.MjData(model), np.empty(len(reference))
    for k, command in enumerate(reference):
        data.ctrl[0], q[k] = command, data.qpos[0]
        mujoco.mj_step(model, data)
    return q + NOISE_RAD * rng.standard_normal(len(q))


def estimate(loss: float, motion: str, seed: int) -> dict[str, float | str]:
    """Return a row of estimates: value and standard deviation of J, f, F_c and of F_c + o."""
    rng = np.random.default_rng(seed)
    reference = commands(motion, rng)
    one, zero, start = np.ones(1), np.zeros(1), time.process_time()
    log = CommandedLog(
        motion, ("1",), RATE_HZ, simulate(loss, reference, rng)[:, None], KP * reference[:, None], KP * one, KD * one,
        zero, np.zeros(1, bool), np.zeros((len(reference), 1)), zero, zero
    )  # fmt: skip
    fit = fit_commanded([log])["1"]
    sums = {name: {name: 1.0} for name in ("inertia", "viscous", "coulomb")} | {"sum": {"coulomb": 1.0, "offset": 1.0}}
    row = {name: fit.combination(weights) for name, weights in sums.items()}
    values = {f"{name}{end}": x for name, pair in row.items() for end, x in zip(("", "_std"), pair, strict=True)}
    return {"motion": motion, "loss": loss, **values, "rms": fit.rms, "cpu_s": time.process_time() - start}


def main() -> None:
    """Print a row for each loss and motion, then the largest errors of Coulomb friction."""
    options = study_run.options(__doc__, "one loss", losses=[0.2, 1.0, 4.0], seed=0)
    rows = []
    for loss in options.losses[: 1 if options.quick else None]:
        for motion in MOTIONS:
            row = estimate(loss, motion, options.seed)
            name = "sum" if motion == "forwards" else "coulomb"
            error = float(row[name]) - loss
            rows.append((abs(error) / loss, abs(error) / float(row[f"{name}_std"]) * (motion != "steps")))
            print(json.dumps(row))
    relative, stds = np.max(rows, axis=0).tolist()
    print(json.dumps({"largest_error": relative, "largest_error_over_std": stds}))
    assert relative < 0.01
    assert stds < 3.5


if __name__ == "__main__":
    main()
