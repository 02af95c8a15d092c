"""Faults of robot files and logs whose true robot is known: responses of an arm that its file describes wrongly.

A `Case` is the true robot, its exact responses as they were read, and the robot of the study. A fault takes a case and
returns a wrong one; `drawn` adds noise last, of a known covariance, and `FAULTS` lists them by name, with the cause
that a fit is to name.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.response import Covariance, Response
from elastid.robot import Joint, Payload, Robot, Tolerances
from elastid.robot.simplified import with_joints, with_stiff_joints
from plants.elastic_arm import CONFIGURATIONS, arm, measure
from plants.elastic_arm import FREQ as FREQ_HZ
from plants.two_mass import circular
from plants.two_mass import drawn as with_noise

RATE_HZ = 1000.0
# Noise of every element relative to it, what the largest value adds, and the degrees of freedom of its variance.
NOISE, ADDED, DOF = 0.005, 1e-4, 8.0
SPRINGS = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
# One search from the springs of the file, which are the true ones; weights by the noise alone.
SPEC = FitSpec(parameters=SPRINGS, starts=1, start_factor=1.0, seed=1, profile=(), weights=WeightSpec(model_error=0.0))


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


Fault = Callable[[Case], Case]


def true_case() -> Case:
    """The arm with 8 kg off the axis of its fore arm, in three postures, as it is."""
    truth = loaded(arm())
    return Case(truth, exact(truth), truth)


def loaded(robot: Robot) -> Robot:
    return replace(robot, payload=Payload(8.0, (0.9, 0.1, 0.15), (0.1, 0.15, 0.2), "fore"))


def exact(robot: Robot) -> tuple[Response, ...]:
    """Motor accelerations per motor torque (60, 2, 2) of each posture."""
    return tuple(replace(response, noise=None) for response in measure(robot))


def drawn(case: Case, rng: np.random.Generator, noise: float = NOISE, dof: float = DOF) -> list[Response]:
    """The responses with noise, whose variance was estimated from so many degrees of freedom."""
    return [_noisy(response, rng, noise, dof) for response in case.responses]


def _noisy(response: Response, rng: np.random.Generator, noise: float, dof: float) -> Response:
    size = np.abs(response.G)
    G, total = with_noise(response.G, noise * size + ADDED * size.max(axis=0), rng, dof)
    return replace(response, G=G, total=total)


def rubbing(case: Case, rng: np.random.Generator, dof: float = DOF) -> list[Response]:
    r"""Responses with the distortion of dry friction, which acts as torques w that the logged ones do not hold.

    .. math:: dG = G W, \qquad \mathrm{cov}(\mathrm{vec}\, G) = I \otimes l^2 G G^H

    level l = 0.01: of the friction torque's distortion over the excitation's torque; its covariance is estimated from
    so many degrees of freedom. What friction adds to fm_* the fit finds.
    """
    responses = []
    for quiet in drawn(case, rng, 0.2 * NOISE, np.inf):
        F, n_y, n_u = quiet.G.shape
        repeated = [circular(rng, (F, n_u, n_u)) for _ in range(int(dof))]
        error = quiet.G @ (0.01 * circular(rng, (F, n_u, n_u)))
        spread = 0.01 * np.stack([quiet.G @ W for W in repeated])  # (dof, F, n_y, n_u)
        right = np.einsum("rfau,rfbu->fab", spread, spread.conj()) / (dof * n_u)
        known = quiet.total
        right += np.eye(n_y) * np.mean(known.variance, axis=2)[:, :, None]
        left = np.broadcast_to(np.eye(n_u), (F, n_u, n_u)).astype(complex)
        variance = np.einsum("faa->fa", right).real[:, :, None] * np.ones(n_u)
        responses.append(replace(quiet, G=quiet.G + error, total=Covariance(variance, dof * n_u, left, right)))
    return responses


def _as_read(changed: Callable[[Response, int], Response]) -> Fault:
    """Responses, each with its number, were read otherwise."""
    return lambda case: replace(case, responses=tuple(changed(r, i) for i, r in enumerate(case.responses)))


def _times(factor: Callable[[FloatArray], ComplexArray | FloatArray]) -> Fault:
    """Responses were read times a factor of frequency, given as (F, 1, 1)."""
    return _as_read(lambda r, _: replace(r, G=r.G * factor(r.freq_hz[:, None, None])))


def _stated(angles: Callable[[FloatArray, int], FloatArray]) -> Fault:
    """Other angles of each posture were stated, made of the true ones and its number."""

    def of(r: Response, i: int) -> Response:
        stated = angles(np.array(r.configuration.angles), i)
        return replace(r, configuration=replace(r.configuration, angles=tuple(stated)))

    return _as_read(of)


def _numbers(case: Case, **factors: float) -> Case:
    """The file has numbers of the robot times factors."""
    known = case.robot.parameters()
    return replace(case, robot=case.robot.with_parameters({n: f * known[n][0] for n, f in factors.items()}))


def wrong_length(case: Case) -> Case:
    """The upper arm is 30 mm longer in the file."""
    upper, fore = case.robot.bodies
    x, y, z = fore.placement.xyz
    longer = replace(fore, placement=replace(fore.placement, xyz=(x, y, z + 0.03)))
    return replace(case, robot=replace(case.robot, bodies=(upper, longer)))


def posture_exchanges(case: Case) -> Case:
    """The responses of the second and third posture carry each other's name and angles."""
    first, second, third = case.responses
    swapped = replace(third, configuration=second.configuration), replace(second, configuration=third.configuration)
    return replace(case, responses=(first, *swapped))


def wrong_gear_ratio(case: Case) -> Case:
    """Both ratios of the file 1 % too large: link-side torques are, angles too small, and rotors too heavy."""

    def geared(joint: Joint) -> Joint:
        motor = joint.motor
        return joint if motor is None else replace(joint, motor=replace(motor, ratio=1.01 * motor.ratio))

    return _times(lambda f: 1.01**-2 * np.ones_like(f))(replace(case, robot=with_joints(case.robot, geared)))


def rotors_on_the_link_side(case: Case) -> Case:
    """The file has n^2 times the inertias of the motors, as referred through their gears."""
    return _numbers(case, **{f"Jm_{joint.name}": case.robot.ratio(joint.name) ** 2 for joint in case.robot.driven})


def soft_day(case: Case) -> Case:
    """In the third posture gear 2 was softer."""
    softer = exact(case.truth.with_parameters({"k_2": SOFT * case.stiffness["k_2"]}))
    return replace(case, responses=(*case.responses[:2], softer[2]))


def behind_gear(case: Case) -> Case:
    """The angle of axis 2 is that of its link."""
    model, s = serial(case.truth), 2j * np.pi * FREQ_HZ[:, None, None]
    linearisation, responses = Linearisation.of(model), []
    for G, angles in zip(case.responses, CONFIGURATIONS, strict=True):
        read = linearisation.at(Configuration("c", angles), model.theta, ("motor 1", "joint 2"), "position")
        Z = s**2 * read.M + s * read.D + read.K
        B = np.broadcast_to(read.B, (len(FREQ_HZ), *read.B.shape))
        responses.append(replace(G, G=s**2 * (read.C @ np.linalg.solve(Z, B))))
    return replace(case, responses=tuple(responses))


@dataclass(frozen=True)
class Named:
    """A fault, the cause that a fit names first for it, the least share of the excess, its steps and their error.

    has_tolerances: of the robot's file.  alike: causes that the data cannot distinguish from it.
    """

    fault: Fault
    cause: str
    share: float = 0.95
    steps: tuple[float, ...] = ()
    within: float = 0.0
    has_tolerances: bool = False
    alike: tuple[str, ...] = ()


def _number(fault: Fault, cause: str, step: float) -> Named:
    """A number that is found to 5 %."""
    return Named(fault, cause, 0.95, (step,), 0.05 * abs(step))


SOFT, OFF = 0.95, np.radians([-2.5, 3.0, -2.0])
FAULTS = {
    "delay left out": _number(_times(lambda f: np.exp(-2j * np.pi * f * 0.3e-3)), "delay", 0.3e-3),
    "link mass +5 %": _number(lambda case: _numbers(case, m_fore=1.05), "m_fore", -math.log(1.05)),
    "link length": replace(_number(wrong_length, "p_fore_z", -0.03), alike=("pj_1_z",)),
    "inertia +20 %": replace(_number(
        lambda case: _numbers(case, I_fore_xx=1.2, I_fore_yy=1.2, I_fore_zz=1.2), "I_fore_*", -math.log(1.2)
    ), alike=("I_fore_yy",)),
    "low pass on all encoders": _number(
        _times(lambda f: 1 / (1 + 1j * f / 200.0)), "low_pass", 1 / (400 * math.pi)
    ),
    "one sample late": _number(
        _times(lambda f: np.exp(-2j * np.pi * f * [[0.0], [1 / RATE_HZ]])), "delay_y_motor_2", 1e-3
    ),
    "gear ratio 1 % wrong": _number(wrong_gear_ratio, "ratio_*", -0.01),
    "torques of a posture": Named(
        _as_read(lambda r, i: replace(r, G=r.G / (1.04 if i == 1 else 1.0))), "torques@c2", 0.0,
        (math.log(1.04),), 0.005,
    ),
    "soft day": Named(soft_day, "spring_2@c3", 0.8, (math.log(SOFT),), 0.2 * abs(math.log(SOFT))),
    "exchanged postures": Named(
        posture_exchanges, "responses of configurations c2 and c3 exchanged", 0.9, has_tolerances=True
    ),
    "mirrored motor": Named(
        _times(lambda f: f**0 * [[1, -1], [-1, 1]]), "motor 2 counted in the other direction, torque and motion", 0.9,
        has_tolerances=True,
    ),
    "negated": Named(_as_read(lambda r, _: replace(r, G=r.G.conj())), "all phases negated", 0.9, has_tolerances=True),
    "velocities": Named(
        _times(lambda f: 1 / (2j * np.pi * f)), "responses differentiated once more in time", 0.9,
        has_tolerances=True,
    ),
    "ceiling": Named(
        lambda case: replace(case, responses=exact(replace(case.truth, gravity=(0.0, 0.0, 9.81)))),
        "gravity along +z of the base", 0.9,
    ),
    "degrees": Named(
        _stated(lambda q, _: np.degrees(q)), "angles of all configurations in degrees, read as radians", 0.99
    ),
    "mirrored axis": Named(
        _stated(lambda q, _: q * (1, -1)), "angle of axis 2 counted in the other direction in all configurations", 0.99
    ),
    "exchanged axes": Named(
        _stated(lambda q, _: q[::-1]), "angles of axes 1 and 2 exchanged in all configurations", 0.99
    ),
    "angles of an axis": Named(
        _stated(lambda q, i: q - (0.0, OFF[i])), "angles_2", 0.9, tuple(OFF.tolist()), math.radians(0.6)
    ),
    "rotors on the link side": Named(
        rotors_on_the_link_side, "inertias of all motors given on the link side, or in kg cm^2", 0.99
    ),
    "behind the gear": Named(behind_gear, "encoder of axis 2 behind the gear", 0.8),
    "rate 2 % wrong": Named(  # frequencies are 2 % too high, and accelerations from logged angles by the square
        _as_read(lambda r, _: replace(r, freq_hz=1.02 * r.freq_hz, G=1.02**2 * r.G)), "rate"
    ),
    "missing torsion": Named(lambda case: replace(case, robot=with_stiff_joints(case.robot, ["2z"])), "torsion_fore_z"),
}  # fmt: skip
# Those whose fits are of further robots or readings, which take seconds.
FURTHER = [*FAULTS][[*FAULTS].index("mirrored motor") : [*FAULTS].index("rate 2 % wrong")]


def faulty(name: str) -> Case:
    """The case with one of the faults."""
    case = FAULTS[name].fault(true_case())
    return replace(case, robot=replace(case.robot, tolerances=Tolerances())) if FAULTS[name].has_tolerances else case
