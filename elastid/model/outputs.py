"""What is measured as CasADi expressions: C(q, theta) and T(q, theta) of `ElasticModel.output_jacobian`, to be derived.

Law and signs are those of `ElasticModel`, which works on numbers.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from elastid.model.elastic import ElasticModel


def readout(model: ElasticModel, q: ca.SX, theta: ca.SX, locations: Sequence[str]) -> tuple[ca.SX, ca.SX]:
    """C and T (n_y, n_q) of places at q (n_q,): rates are C v, accelerometers read C q'' + T q."""
    rows = ca.vertsplit(ca.vertcat(model.angular_velocity(q), model.frame_velocity(q, theta)))
    rates = dict(zip(model.rates, rows, strict=True))
    names = [frame.name for frame in model.robot.frames]
    gravity = model.frame_gravity(q)
    C, T = [], []
    for place in locations:
        kind, _, rest = place.partition(" ")
        still = ca.SX(1, model.n_q)
        if kind in ("motor", "joint"):
            still[model.index(place)] = 1
            C.append(still)
            T.append(ca.SX(1, model.n_q))
            continue
        name, axis = rest.rsplit(" ", 1)
        C.append(rates["frame" if kind == "accelerometer" else kind, name, axis])
        if kind != "accelerometer":
            T.append(still)
            continue
        turning = ca.vertcat(*(rates["frame", name, f"r{letter}"] for letter in "xyz"))
        g = gravity[3 * names.index(name) : 3 * names.index(name) + 3]
        T.append(-(ca.skew(g) @ turning)["xyz".index(axis), :])
    return ca.vertcat(*C), ca.vertcat(*T)
