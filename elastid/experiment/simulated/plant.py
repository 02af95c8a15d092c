r"""The simulated plant: the true robot as equations, alone and in its closed loop, and its linear prediction.

.. math:: u = [I + F H P]^{-1} r, \qquad q_m = H P u, \qquad F = k_p + k_d (1 - z^{-1}) / T_s

r: injected torque, P: motor torque to motor angle, H: hold of the controller, F: its feedback. Damping by Coulomb
friction is left out. Link side, SI.

Three masses in a row on springs to the ground, shaken at two of them: a structure without joints, as a log has it.

.. math:: M \ddot x + D \dot x + K x = B u, \qquad Y = -\omega^2 C\, [K - \omega^2 M + j \omega D]^{-1} B\, U
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen, laplace_variable
from elastid.base.errors import DataError, Note, StudyError
from elastid.base.units import Quantity, to_si
from elastid.excitation.multisine import synthesise
from elastid.excitation.spec import Injected
from elastid.experiment.plan.plan import ClosedLoopResponse, PredictClosedLoop
from elastid.experiment.plan.reference_trajectory import FeedForward, Movement
from elastid.experiment.simulated.hardware import drives
from elastid.experiment.specs.simulated import SimulatedSpec, TorqueRippleSpec
from elastid.friction.robot_friction import frictions
from elastid.linear.equilibrium import OperatingPoint, equilibrium
from elastid.linear.linear_model import torque_elements
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import frequency_response
from elastid.model.elastic import ElasticModel
from elastid.model.formulation import EXACT, formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration, drive_unit, zero_order_hold
from elastid.robot import Robot
from elastid.robot.friction_numbers import friction_numbers, with_numbers
from elastid.simulation.closed_loop import ClosedLoop, closed_loop
from elastid.simulation.contacts import contacts
from elastid.simulation.controller import feed_forward, filters_of, gains_of, sampled_responses
from elastid.simulation.dynamics import poles
from elastid.simulation.runge_kutta import MAX_SUBSTEPS, least_steps
from elastid.simulation.spec import ControllerSpec

MAX_CLIPPED_FRACTION = 0.5  # of the samples, beyond which a motor cannot control the robot


@dataclass(frozen=True, eq=False)
class Plant:
    """The true robot as equations, its closed loop, and its rest."""

    model: ElasticModel
    loop: ClosedLoop
    point: OperatingPoint


def true_robot(robot: Robot, truth: Mapping[str, Quantity]) -> Robot:
    """Return the robot with the true parameters; StudyError for a name that it does not have."""
    if not truth:
        return robot
    unit = {name: unit for name, (_, unit) in (robot.parameters(robot.on_demand) | friction_numbers(robot)).items()}
    try:
        # A name that the robot does not have gets any number; with_parameters refuses it and says which there are.
        return with_numbers(
            robot, {name: to_si(value, unit[name]) if name in unit else 0.0 for name, value in truth.items()}
        )
    except ValueError as error:
        raise StudyError("experiment/simulated", str(error), "experiment.simulated.truth") from None


def model_of(robot: Robot, spec: ModelSpec = EXACT) -> ElasticModel:
    """Return the equations of a robot, built once in a process."""
    return _model_of(robot, spec)  # a cache takes a default and the same value for two keys


_model_of = lru_cache(maxsize=4)(formulate)


@lru_cache(maxsize=4)
def _loop_of(
    robot: Robot, equations: ModelSpec, rate_hz: float, substeps: int, encoder_counts: int,
    torque_ripple: tuple[TorqueRippleSpec, ...], saturation: bool, controller: ControllerSpec, samples: int,
    is_free: bool, has_theta: bool,
) -> ClosedLoop:  # fmt: skip
    """Return the closed loop of a robot, built once in a process: CasADi expressions do not pickle."""
    model = model_of(robot, equations)
    limits = np.array([(-np.inf, np.inf) if is_free else joint.limits.angle for joint in robot.driven])
    hardware = drives(robot, encoder_counts, torque_ripple, saturation)
    sliding = contacts(model, frictions(robot))
    filters = filters_of(robot.driven_names, controller, rate_hz)
    return closed_loop(model, sliding, limits, rate_hz, substeps, hardware, samples, has_theta, filters)


def true_plant(
    robot: Robot, spec: SimulatedSpec, rate_hz: float, start: Configuration, highest_hz: float = 0.0, samples: int = 0,
    is_free: bool = False, has_theta: bool = False
) -> Plant:  # fmt: skip
    """Return the plant of a section `simulated`, with its truth, at rest in `start`.

    highest_hz: the end of the band, if any.  samples: about how many the whole plan has, for which steps are compiled
    where the section asks for it.  is_free: without limits of the motors' angles.  has_theta: each run has numbers of
    its own, for whose poles a fifth is to spare.  StudyError where the integration steps are too long for the fastest
    pole.
    """
    robot = true_robot(robot, spec.truth).carrying(start.has_payload)
    model = model_of(robot, spec.model)
    point = equilibrium(model, model.theta, start)
    s, fastest = poles(model, contacts(model, frictions(robot)), point.q)
    min_steps = least_steps(1.2 * s if has_theta else s, 1 / rate_hz)
    # The rate of a recorded log cannot be raised: it has the steps in a second of a log of 1 kHz.
    max_steps = spec.substeps or max(MAX_SUBSTEPS, int(1000.0 / rate_hz * MAX_SUBSTEPS) if is_free else 0)
    if min_steps > max_steps:
        raise StudyError(
            "experiment/simulated",
            f"configuration {start.name}: the fastest mode, of {fastest}, needs {min_steps} steps per sample at "
            f"{rate_hz:g} Hz; limit {max_steps}. Raise the rate",
            "experiment.simulated.substeps",
        )
    substeps = max(min_steps, spec.steps(rate_hz, highest_hz))
    hardware = spec.noise.encoder_counts, spec.torque_ripple, spec.saturation, spec.controller
    compiled = samples if spec.compiled else 0
    return Plant(model, _loop_of(robot, spec.model, rate_hz, substeps, *hardware, compiled, is_free, has_theta), point)


def holding_torque(model: ElasticModel, point: OperatingPoint, index: int, position: FloatArray) -> FloatArray:
    """Return u (m, n_u) that holds the robot with one joint at positions (m,), the others as in the operating point."""
    offset = np.zeros((len(position), model.n_u))
    offset[:, index] = position - point.configuration.angles[index]
    still = np.zeros_like(offset)
    return feed_forward(model, point.q, offset, still, still)


def limit_notes(plant: Plant, run: str, u: FloatArray, motors: Iterable[int]) -> Iterator[Note]:
    """Yield a note for each of some motors whose torque u (n, n_u) was clipped, or went beyond its limit.

    DataError where most of it was clipped.
    """
    for i in motors:
        joint, drive, torque = plant.model.robot.driven[i], float(plant.loop.drives.torque[i]), np.abs(u[:, i])
        place, unit, fraction = f"{run}, motor {joint.name}", drive_unit(joint.slides), float(np.mean(torque >= drive))
        text = f"saturated at its torque limit of {drive:.4g} {unit} in {max(fraction, 1e-4):.2%} of the samples"
        if fraction > MAX_CLIPPED_FRACTION:
            raise DataError(
                "experiment/diverged",
                f"{text} and cannot control the robot. Lower excitation.torque_rms, choose a configuration with less "
                "gravity torque, or correct limits.torque",
                place,
            )
        if fraction > 0:
            yield Note("experiment/limits", f"{text}; {_LOWER}", place)
        elif torque.max() > joint.limits.torque:
            yield limit_note(place, torque.max(), joint.limits.torque, unit)


def limit_note(location: str, peak: float, limit: float, unit: str) -> Note:
    """Return a note on a motor that exceeded a limit which its drive does not enforce."""
    return Note("experiment/limits", f"reached {peak:.4g} {unit}; its limit is {limit:.4g} {unit}; {_LOWER}", location)


_LOWER = "lower excitation.torque_rms, or the highest speed of passes"


def closed_loop_of(
    robot: Robot, controller: ControllerSpec, rate_hz: float, inject: Injected = "torque"
) -> PredictClosedLoop:
    """Return the closed-loop response of the nominal robot and a controller at rate_hz, as `make_plan` takes it.

    It raises StudyError where a configuration has no equilibrium, or references are injected without their path.
    """
    return partial(_closed_loop_response, robot, controller, rate_hz, inject)


def _closed_loop_response(
    robot: Robot, controller: ControllerSpec, rate_hz: float, inject: Injected, configuration: Configuration,
    freq_hz: FloatArray,
) -> ClosedLoopResponse:  # fmt: skip
    linearisation = Linearisation.of_robot(robot)
    model = linearisation.model
    linear = linearisation.at(configuration, model.theta, model.inputs, "position")
    # The controller reads motions without the errors of the log.
    linear = replace(linear, chain=torque_elements(robot.chain), channel_numbers=())
    loop = gains_of(model, equilibrium(model, model.theta, configuration).q, controller)
    s = laplace_variable(freq_hz[:, None, None])
    P = zero_order_hold(freq_hz / rate_hz)[:, None, None] * frequency_response(linear, linear.theta_ref, freq_hz)
    F, entry = sampled_responses(robot.driven_names, loop, controller, freq_hz, rate_hz, inject)
    difference, torque = np.eye(model.n_u) + F[:, :, None] * P, np.eye(model.n_u, dtype=np.complex128)
    if inject == "torque":
        torque = np.asarray(np.linalg.inv(difference), np.complex128)
    position = np.asarray(P @ torque, np.complex128)
    reference = np.asarray(difference @ torque / entry[:, :, None], np.complex128)
    return ClosedLoopResponse(np.broadcast_to(torque, P.shape), position, s * position, s**2 * position, reference)


def feed_forward_of(model: ElasticModel) -> FeedForward:
    """Return the feed-forward torque of a rigid robot, as `reference` takes it."""

    def torque(configuration: Configuration, path: Movement) -> FloatArray:
        q0 = equilibrium(model, model.theta, configuration).q
        signals = np.stack([path.position, path.velocity, path.acceleration])
        return _feed_forward(model, tuple(q0.tolist()), signals.shape, signals.tobytes())

    return torque


@lru_cache(maxsize=16)
def _feed_forward(model: ElasticModel, q0: tuple[float, ...], shape: tuple[int, ...], path: bytes) -> FloatArray:
    """Compute the torque (n, n_u) along a path (3, n, n_u), cached: all runs of a configuration follow the same."""
    return frozen(feed_forward(model, np.array(q0), *np.frombuffer(path).reshape(shape)))


# kg, N/m (ground to first, first to second ...), and modal damping.
MASSES = (2.0, 1.5, 1.0)
STIFFNESSES = (30e3, 40e3, 25e3)
DAMPING = (0.010, 0.015, 0.020)
# The masses that a shaker pushes, and the lines, as parts of the rate, that both shakers excite.
EXCITED_STATES = (0, 2)
BAND = (0.01, 0.4)


def true_modes() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute natural frequencies (3,), rad/s, damping ratios (3,), and modes (3, 3), columns of unit modal mass."""
    root = np.diag(1 / np.sqrt(MASSES))
    k = np.array([*STIFFNESSES, 0.0])
    K = np.diag(k[:-1] + k[1:]) - np.diag(k[1:-1], 1) - np.diag(k[1:-1], -1)
    squares, vectors = np.linalg.eigh(root @ K @ root)
    return np.sqrt(squares), np.array(DAMPING), root @ vectors


def true_response(freq_hz: FloatArray) -> ComplexArray:
    """Return G (F, 3, 2): acceleration of each mass per force of each shaker, m/s^2 per N."""
    natural, damping, shapes = true_modes()
    omega = 2 * np.pi * freq_hz[:, None]
    modal = -(omega**2) / (natural**2 - omega**2 + 2j * damping * natural * omega)
    return np.asarray(np.einsum("ir,fr,jr->fij", shapes, modal, shapes[list(EXCITED_STATES)]))


def shake(rate_hz: float, period_samples: int, periods: int, seed: int) -> list[FloatArray]:
    """Simulate forces in N and accelerations in m/s^2 (n, 2 + 3) in both experiments of one realisation of a multisine.

    In steady state, with sensor noise.  In the second the second shaker pushes with the other sign, so that the two
    separate the shakers at every line.
    """
    random = np.random.default_rng(seed)
    lines = np.arange(round(BAND[0] * period_samples), round(BAND[1] * period_samples))
    U = 5.0 * np.sqrt(2 / len(lines)) * np.exp(2j * np.pi * random.random((len(lines), len(EXCITED_STATES))))
    G, experiments = true_response(lines * rate_hz / period_samples), []
    for F in (U, U * [1, -1]):
        pairs = ((F, 0.05), ((G @ F[..., None])[..., 0], 0.1))
        signals = [(np.tile(synthesise(lines, X, period_samples), (periods, 1)), std) for X, std in pairs]
        experiments.append(np.hstack([x + std * random.standard_normal(x.shape) for x, std in signals]))
    return experiments
