"""What keeps the loop of a simulated linkage closed, and what its energy does: Baumgarte's terms against projection.

    python scripts/studies/linkage_simulation.py [--quick]

The shipped planar arm without damping, friction and torque, let go from a posture with bent springs: T + V must stay,
phi must stay 0. For steps of 0.1 and 0.5 ms, ddphi + alpha dphi + beta phi = 0 with several (alpha, beta), projection
after every step, and the minimal model with its rod cut, which has no loop. The drift of the energy is that of the
integrator and hardly differs. In 2 s of motion phi reaches 1e-11 m (0.1 ms) and 2e-8 m (0.5 ms) without Baumgarte's
terms, a tenth of that with them, and rounding with the projection.
The last line is one JSON object with the numbers of the table.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.linear.equilibrium import equilibrium
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.simulation.dynamics import energy, free_acceleration, projection, runge_kutta_step, violation
from elastid.study import load_robot

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "linkage_arm.yml"
POSE = (0.4, 0.1)
KICK = 0.5  # rad/s of the first motor
DAMPING = ("d", "f", "fm")


def undamped(formulation: str) -> ElasticModel:
    """The arm without any dissipation."""
    model = formulate(load_robot(ROBOT), ModelSpec(formulation))
    theta = np.array(model.theta)
    theta[[name.split("_")[0] in DAMPING for name in model.parameters]] = 0.0
    return replace(model, theta=theta)


def swung(model: ElasticModel, step: float, seconds: float, stabilisation: str) -> tuple[FloatArray, FloatArray]:
    """q and v (n, n_q) every 10 ms after a kick from rest; stabilisation: `alpha, beta` or `projection`."""
    alpha, beta = (0.0, 0.0) if stabilisation == "projection" else map(float, stabilisation.split(","))
    free, unforced = free_acceleration(model, alpha, beta), ca.SX(model.n_q, 1)
    q0, v0, z = ca.SX.sym("q", model.n_q), ca.SX.sym("v", model.n_q), ca.SX(0, 1)
    q, v, _ = runge_kutta_step(lambda q, v, z, u: free(q, v, u), lambda z, v, step: z, q0, v0, z, (unforced,) * 4, step)
    if stabilisation == "projection" and model.n_c:
        q, v = projection(model)(q, v)
    per_sample = round(0.01 / step)
    advance = ca.Function("step", [q0, v0], [q, v], {"cse": True}).mapaccum("advance", per_sample, 2, {})
    q, v = started(model)
    path = [(q, v)]
    for _ in range(round(seconds / 0.01)):
        ends = advance(*path[-1])
        path.append((ends[0].full()[:, -1], ends[1].full()[:, -1]))
    return np.array([q for q, _ in path]), np.array([v for _, v in path])


def started(model: ElasticModel) -> tuple[FloatArray, FloatArray]:
    """Rest in POSE with the first motor kicked, on the closed loop."""
    q = np.array(equilibrium(model, model.theta, Configuration("start", POSE)).q)
    v = KICK * model.B[:, 0]
    if not model.n_c:
        return q, v
    close = projection(model)
    for _ in range(6):
        q, v = (value.full()[:, 0] for value in close(q, v))
    return q, v


def measured(formulation: str, step: float, seconds: float, stabilisation: str) -> dict[str, object]:
    """Largest |phi|, and largest change of T + V as a part of what V changes by."""
    model = undamped(formulation)
    q, v = swung(model, step, seconds, stabilisation)
    E = energy(model, q, v)
    V = energy(model, q, 0 * v)
    return {
        "formulation": formulation,
        "stabilisation": stabilisation if model.n_c else "no loop",
        "step_s": step,
        "largest_phi": violation(model, q),
        "energy_drift": float(np.abs(E - E[0]).max() / np.ptp(V)),
    }


def main() -> None:
    """The table and its JSON line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="shorter motion, fewer cases")
    quick = parser.parse_args().quick
    ways = ("0, 0", "20, 100", "projection") if quick else ("0, 0", "10, 10", "20, 100", "200, 1e4", "projection")
    cases = [("constrained", way) for way in ways] + [("minimal", "0, 0")]
    rows = [
        measured(formulation, step, 0.2 if quick else 2.0, way) for step in (1e-4, 5e-4) for formulation, way in cases
    ]
    print(f"{'formulation':<14}{'alpha, beta':<14}{'step, s':>9}{'largest |phi|':>16}{'energy drift':>15}")
    for row in rows:
        print(
            f"{row['formulation']:<14}{row['stabilisation']:<14}{row['step_s']:>9.0e}"
            f"{row['largest_phi']:>16.1e}{row['energy_drift']:>15.1e}"
        )
    print(json.dumps({"cases": rows}))


if __name__ == "__main__":
    main()
