r"""Effect of the amplitude on a nonlinear spring: under a multisine it is stiffer, or softer, than at rest.

.. math:: k_{eq} = E[\tau'(\Delta_0 + \sigma \xi)], \quad \xi \sim N(0, 1), \qquad
          k_{eq} - k_t = 3 k_3 \sigma^2 \text{ of a cubic spring}

Delta_0: the deflection under gravity, k_t = tau'(Delta_0): the stiffness in the model, sigma: rms deflection by the
multisine, k_eq: the best linear approximation of the spring alone under normal excitation (Bussgang 1952; Pintelon and
Schoukens 2012, ch. 3). The fit finds k_eq in the place of k_t.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.note import Note
from elastid.design.prospect import Prospect
from elastid.linear.equilibrium import equilibrium
from elastid.linear.spring_preload import preloads
from elastid.model.elastic import ElasticModel
from elastid.model.nonlinear_springs import deflections, tangents_at
from elastid.record import Configuration

# Relative change of the tangent stiffness by the amplitude that is not reported.
MAX_CHANGE = 0.02
# Gauss-Hermite quadrature: exact for polynomials, within a few percent at the flanks of a gap.
N_NODES = 41


@dataclass(frozen=True)
class Stiffening:
    """The springs of a configuration: sigma (n_s,), rms deflection in the run that has most; change k_eq / k_t - 1."""

    configuration: str
    joints: tuple[str, ...]
    sigma: FloatArray
    change: FloatArray


def stiffening(prospect: Prospect, configuration: Configuration, x: FloatArray) -> Stiffening:
    """The effect of a plan on the springs of a robot with parameters x (n_x,); StudyError without equilibrium."""
    model = prospect.linearisation.model
    theta = prospect.parameters.expand(x)[:-1]
    (load,) = preloads(model, theta, [equilibrium(model, theta, configuration)])
    X = prospect.motion(configuration, x) @ _rows(model, load.joints).T
    sigma = np.sqrt(np.sum(np.abs(X) ** 2, axis=1) / 2).max(axis=0)
    nodes, weights = np.polynomial.hermite_e.hermegauss(N_NODES)
    tangent = _tangents(model, load.joints)
    at_nodes = np.array([tangent(load.deflection + sigma * node, theta).full()[:, 0] for node in nodes])
    k_eq = weights @ at_nodes / weights.sum()
    return Stiffening(configuration.name, load.joints, sigma, k_eq / load.tangent - 1)


def stiffening_notes(prospects: Sequence[Prospect], points: Sequence[Configuration], x: FloatArray) -> tuple[Note, ...]:
    """A note for each spring that the planned amplitude changes by more than MAX_CHANGE; x (n_x,)."""
    if all(joint.spring is None or joint.spring.is_linear for joint in prospects[0].robot.joints):
        return ()
    found = [stiffening(prospect, point, x) for prospect, point in zip(prospects, points, strict=True)]
    units = {joint.name: joint.unit for joint in prospects[0].robot.joints}
    return tuple(note for i, joint in enumerate(found[0].joints) for note in _notes(joint, units[joint], found, i))


def _notes(joint: str, unit: str, found: Sequence[Stiffening], i: int) -> Iterator[Note]:
    worst = max(found, key=lambda one: abs(one.change[i]))
    change = float(worst.change[i])
    if abs(change) > MAX_CHANGE:
        yield Note(
            "stiffened-spring",
            f"the multisine deflects its spring by {worst.sigma[i]:.2g} {unit} rms in {worst.configuration}, which "
            f"makes it {abs(change):.1%} {'stiffer' if change > 0 else 'softer'} than the tangent at rest of the "
            "model, and biases the estimates by as much; lower excitation.torque_rms of its motors by a factor of "
            f"{np.sqrt(abs(change) / MAX_CHANGE):.1f} or more",
            f"joint {joint}",
        )


def _rows(model: ElasticModel, joints: Sequence[str]) -> FloatArray:
    """z (n_s, n_q): springs are deflected by z q."""
    q = ca.SX.sym("q", model.n_q)
    deflection = deflections(model.robot, q)
    jacobian = ca.jacobian(ca.vertcat(*(deflection[name] for name in joints)), q)
    return np.asarray(ca.DM(ca.evalf(jacobian)).full())


def _tangents(model: ElasticModel, joints: Sequence[str]) -> ca.Function:
    """Tangent stiffness (n_s,) at deflections (n_s,) and parameters (n_theta,)."""
    deflection, theta = ca.SX.sym("deflection", len(joints)), ca.SX.sym("theta", len(model.parameters))
    named = dict(zip(model.parameters, ca.vertsplit(theta), strict=True))
    found = tangents_at(dict(zip(joints, ca.vertsplit(deflection), strict=True)), named)
    return ca.Function("tangents", [deflection, theta], [ca.vertcat(*found.values())])
