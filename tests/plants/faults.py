"""Faults of robot files and logs whose true robot is known: responses of an arm that its file describes wrongly.

A `Case` is the true robot, its exact responses as they were read, and the robot of the study. A fault takes a case and
returns a wrong one; `drawn` adds noise last, of a known covariance, and `FAULTS` lists them by name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Payload, Robot
from elastid.robot.simplified import stiffened
from plants.elastic_arm import arm

RATE_HZ = 1000.0
FREQ_HZ = np.linspace(2, 60, 60)
CONFIGURATIONS = ((0.0, 0.0), (0.6, -0.7), (-0.4, 0.9))
# Noise of every element relative to it, what the largest value adds, and the degrees of freedom of its variance.
NOISE, ADDED, DOF = 0.005, 1e-4, 8.0
SPRINGS = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
# One search from the springs of the file, which are the true ones; weights by the noise alone.
SPEC = FitSpec(parameters=SPRINGS, starts=1, start_factor=1.0, seed=1, profile=(), weights=WeightSpec(floor=0.0))


@dataclass(frozen=True)
class Case:
    """truth: the robot that was measured.  responses: as they were read.  robot: of the study."""

    truth: Robot
    responses: tuple[Response, ...]
    robot: Robot

    @property
    def stiffness(self) -> dict[str, float]:
        """The true stiffnesses of the springs that the robot of the study has, N m/rad."""
        numbers = self.truth.parameters()
        return {name: numbers[name][0] for name in self.robot.parameters() if name.startswith("k_")}


Fault: TypeAlias = Callable[[Case], Case]


def true_case() -> Case:
    """The arm with 8 kg off the axis of its fore arm, in three postures, as it is."""
    truth = loaded(arm())
    return Case(truth, exact(truth), truth)


def loaded(robot: Robot) -> Robot:
    """The robot with its payload."""
    return replace(robot, payload=Payload(8.0, (0.9, 0.1, 0.15), (0.1, 0.15, 0.2), "fore"))


def exact(robot: Robot) -> tuple[Response, ...]:
    """Motor accelerations per motor torque (60, 2, 2) of each posture."""
    model = serial(robot)
    linearisation = Linearisation.of(model)
    responses = []
    for i, angles in enumerate(CONFIGURATIONS):
        configuration = Configuration(f"c{i + 1}", angles)
        linear = linearisation.at(configuration, model.theta, robot.motor_locations, "acceleration")
        responses.append(to_response(linear, np.append(model.theta, 0.0), FREQ_HZ))
    return tuple(responses)


def drawn(case: Case, rng: np.random.Generator, noise: float = NOISE, dof: float = DOF) -> list[Response]:
    """The responses with noise, whose variance was estimated from so many degrees of freedom."""
    return [_noisy(response, rng, noise, dof) for response in case.responses]


def _noisy(response: Response, rng: np.random.Generator, noise: float, dof: float) -> Response:
    size = np.abs(response.G)
    std = noise * size + ADDED * size.max(axis=0)
    error = std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / np.sqrt(2)
    variance = std**2 * (rng.chisquare(2 * dof, std.shape) / (2 * dof) if np.isfinite(dof) else 1.0)
    return replace(response, G=response.G + error, total=Covariance(variance, dof))


def rubbing(case: Case, rng: np.random.Generator, level: float = 0.01, dof: float = DOF) -> list[Response]:
    r"""Responses with the distortion of dry friction, which acts as torques w that the logged ones do not hold.

    .. math:: dG = G W, \qquad \mathrm{cov}(\mathrm{vec}\, G) = I \otimes l^2 G G^H

    level l: of the friction torque's distortion over the excitation's torque; its covariance is estimated from so many
    degrees of freedom. What friction adds to fm_* the fit finds.
    """
    responses = []
    for quiet in drawn(case, rng, 0.2 * NOISE, np.inf):
        F, n_y, n_u = quiet.G.shape
        repeated = [_circular(rng, (F, n_u, n_u)) for _ in range(int(dof))]
        error = quiet.G @ (level * _circular(rng, (F, n_u, n_u)))
        spread = level * np.stack([quiet.G @ W for W in repeated])  # (dof, F, n_y, n_u)
        right = np.einsum("rfau,rfbu->fab", spread, spread.conj()) / (dof * n_u)
        known = quiet.total
        assert known is not None
        right += np.eye(n_y) * np.mean(known.variance, axis=2)[:, :, None]
        left = np.broadcast_to(np.eye(n_u), (F, n_u, n_u)).astype(complex)
        variance = np.einsum("faa->fa", right).real[:, :, None] * np.ones(n_u)
        responses.append(replace(quiet, G=quiet.G + error, total=Covariance(variance, dof * n_u, left, right)))
    return responses


def _circular(rng: np.random.Generator, shape: tuple[int, ...]) -> ComplexArray:
    return np.asarray(rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def _numbers(**factors: float) -> Fault:
    """The file has numbers of the robot times factors."""

    def of(case: Case) -> Case:
        known = case.robot.parameters()
        return replace(case, robot=case.robot.with_parameters({n: f * known[n][0] for n, f in factors.items()}))

    return of


def _times(factor: Callable[[FloatArray], ComplexArray | FloatArray]) -> Fault:
    """The responses were read times a factor of frequency, of shape (F, n_y, n_u) or broadcast to it."""

    def of(case: Case) -> Case:
        return replace(case, responses=tuple(replace(r, G=r.G * factor(r.freq_hz)) for r in case.responses))

    return of


def _late(seconds: float) -> Fault:
    return _times(lambda f: np.exp(-2j * np.pi * f * seconds)[:, None, None])


def _one_channel_late(case: Case) -> Case:
    """The encoder of motor 2 is one sample behind everything else."""
    late = np.array([[0.0], [1.0]]) / RATE_HZ
    return _times(lambda f: np.exp(-2j * np.pi * f[:, None, None] * late))(case)


def _low_pass(corner_hz: float, *outputs: int) -> Fault:
    filtered = np.array([[1.0 if i in outputs else 0.0] for i in range(2)])
    return _times(lambda f: 1 / (1 + 1j * f[:, None, None] / corner_hz * filtered))


def forgotten_payload(case: Case) -> Case:
    """The file does not have it."""
    return replace(case, robot=replace(case.robot, payload=None))


def wrong_length(case: Case, by: float = 0.03) -> Case:
    """The upper arm is so many metres longer in the file."""
    upper, fore = case.robot.bodies
    x, y, z = fore.placement.xyz
    longer = replace(fore, placement=replace(fore.placement, xyz=(x, y, z + by)))
    return replace(case, robot=replace(case.robot, bodies=(upper, longer)))


def reference_as_current(case: Case) -> Case:
    r"""The channel of the torque holds the excitation r of a position loop, u = r - C q.

    .. math:: Y R^{-1} = G (I + C G_q)^{-1}, \qquad G_q = G / (j \omega)^2
    """

    def of(response: Response) -> Response:
        s = 2j * np.pi * response.freq_hz[:, None, None]
        bandwidth = 2 * np.pi * 3.0
        # A crossover at 3 Hz of the joints' stiff inertias, link side, 1 / |G| at the lowest line.
        inertia = np.array([1.0 / abs(response.G[0, i, i]) for i in range(2)])
        C = (bandwidth**2 + 1.4 * bandwidth * s) * np.diag(inertia)
        return replace(response, G=response.G @ np.linalg.inv(np.eye(2) + C @ (response.G / s**2)))

    return replace(case, responses=tuple(map(of, case.responses)))


def exchanged_postures(case: Case) -> Case:
    """The responses of the second and third posture carry each other's name and angles."""
    first, second, third = case.responses
    swapped = replace(third, configuration=second.configuration), replace(second, configuration=third.configuration)
    return replace(case, responses=(first, *swapped))


def mirrored_motor(case: Case) -> Case:
    """Torque and angle of motor 2 count in the other direction."""
    signs = np.array([1.0, -1.0])
    return _times(lambda f: np.broadcast_to(np.outer(signs, signs), (len(f), 2, 2)))(case)


def wrong_rate(case: Case, factor: float = 1.02) -> Case:
    """The rate was stated too high: frequencies are, and accelerations from logged angles by the square."""
    scaled = (replace(r, freq_hz=factor * r.freq_hz, G=factor**2 * r.G) for r in case.responses)
    return replace(case, responses=tuple(scaled))


def missing_torsion(case: Case) -> Case:
    """The file has no spring across the axis of the fore arm."""
    return replace(case, robot=stiffened(case.robot, ["2z"]))


def wrong_gear_ratio(case: Case, factor: float = 1.01) -> Case:
    """Both ratios of the file too large: link-side torques are, angles too small, and rotors too heavy."""

    def geared(robot: Robot) -> Robot:
        bodies = []
        for body in robot.bodies:
            joints = tuple(
                joint
                if joint.motor is None
                else replace(joint, motor=replace(joint.motor, ratio=factor * joint.motor.ratio))
                for joint in body.joints
            )
            bodies.append(replace(body, joints=joints))
        return replace(robot, bodies=tuple(bodies))

    return _times(lambda f: np.full((len(f), 1, 1), factor**-2))(replace(case, robot=geared(case.robot)))


FAULTS: Mapping[str, Fault] = {
    "delay left out": _late(0.3e-3),
    "link mass +5 %": _numbers(m_fore=1.05),
    "payload forgotten": forgotten_payload,
    "link length": wrong_length,
    "inertia +20 %": _numbers(I_fore_xx=1.2, I_fore_yy=1.2, I_fore_zz=1.2),
    "low pass on one encoder": _low_pass(200.0, 1),
    "low pass on all encoders": _low_pass(200.0, 0, 1),
    "one sample late": _one_channel_late,
    "reference recorded as current": reference_as_current,
    "exchanged postures": exchanged_postures,
    "mirrored motor": mirrored_motor,
    "rate 2 % wrong": wrong_rate,
    "torque constants 20 % wrong": _times(lambda f: np.full((len(f), 1, 1), 1 / 1.2)),
    "missing torsion": missing_torsion,
    "gear ratio 1 % wrong": wrong_gear_ratio,
}
