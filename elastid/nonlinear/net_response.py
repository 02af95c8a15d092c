r"""Responses of records with compensated motor friction, and their systematic errors by the friction coefficients.

An error df of the coefficients leaves a torque in U that is equal in all configurations. For basis functions at motor j

.. math:: \delta G = G\, e_j\, (\Phi\, df)\, U_{net}^+, \qquad U_{net} = U - \Phi f

With the covariance L L^T of the coefficients, each column of L is a systematic error of known size, which does not
scatter between realisations. An error dt of the time of reversals has the same form with j omega dt Phi f for Phi df.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, interpolate, laplace_variable
from elastid.base.errors import DataError, Note, StudyError
from elastid.fit.parameter_selection import local_ratio_std
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.compensate_friction import compensated_records, to_shafts
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.spectra import ConfigurationSpectra, compensation_torque, gather_configuration
from elastid.record import MOTION_ORDER, Record
from elastid.response import SYSTEMATIC_ERRORS, UNEXPLAINED, Response
from elastid.robot import Robot

TURNING_ERROR = 0.02  # delay of the estimated reversals, in samples
# Least ratio of the variance of a response to its variance by noise, and by noise and the arm's own nonlinearity
# (medians of elements), for a note on distortion that motor friction does not explain.
MIN_UNEXPLAINED = 10.0


def estimate_net_response(
    records: Sequence[Record], friction: CompensatedFriction | None, spec: EstimatorSpec,
    planned_lines: IntArray | None = None, E: FloatArray | None = None, robot: Robot | None = None,
    spectra: ConfigurationSpectra | None = None,
) -> Response:  # fmt: skip
    """Estimate G of one configuration from the net torques of its records, with its systematic errors.

    E: gear couplings from motor shafts, at which friction acts, to links; None without couplings.  robot: nominal
    model, which gives the distortion by the arm; None without one.  spectra: along the motion of the samples, if known.
    Raises DataError as `estimate` does.
    """
    net = tuple(compensated_records(records, friction, E))
    response = estimate(net, spec, planned_lines)
    first, largest = records[0], np.max([np.ptp(record.y, axis=0) for record in records], axis=0).tolist()
    motions = dict(zip(zip(first.outputs, first.quantities, strict=True), largest, strict=True))
    travel = {motor: motions.get((motor, "position"), 0.0) for motor in first.inputs}
    response = replace(response, ratio_std=local_ratio_std(robot, travel))
    if friction is None:
        return response
    arm = partial(_arm_variance, net, response, spec, planned_lines, robot)
    response = replace(response, notes=(*response.notes, *_unexplained_torque(response, records, friction, arm)))
    if not friction.shapes:
        return response
    if spectra is None:
        on_shafts = (to_shafts(record, E) for record in records)
        spectra = gather_configuration(on_shafts, friction.shapes, spec, planned_lines)
    errors = _coefficient_errors(spectra, first.rate_hz, friction, response, E)
    bias = np.zeros((SYSTEMATIC_ERRORS, *errors.shape[1:]), complex) if response.bias is None else response.bias
    return replace(response, bias=np.concatenate([bias[:-1], errors, bias[-1:]]))


def _unexplained_torque(
    response: Response, records: Sequence[Record], friction: CompensatedFriction, arm: Callable[[], FloatArray | float]
) -> tuple[Note, ...]:
    """Return a note if the distortion of a response exceeds noise and arm(), the variance by the arm's motion."""
    if not friction.configurations or response.noise is None or response.total is None:
        return ()
    total, noise = response.total.variance, response.noise.variance
    is_noisy = noise > 0
    ratio = float(np.median(total[is_noisy] / noise[is_noisy])) if is_noisy.any() else 0.0
    if ratio < MIN_UNEXPLAINED or np.median((total / (noise + arm()))[is_noisy]) < MIN_UNEXPLAINED:
        return ()
    rms = np.sqrt(np.mean([np.var(record.u, axis=0) for record in records], axis=0))
    coulomb = [friction.coulomb_friction(location)[0] for location in response.inputs]
    sticking = [location for location, F_c, limit in zip(response.inputs, coulomb, rms / 3, strict=True) if F_c > limit]
    cure = "add `gears: {}` to the study"
    if sticking:
        cure = f"raise excitation.torque_rms: friction stops {' and '.join(sticking)} at this amplitude"
    text = (
        f"nonlinear distortion is {np.sqrt(ratio):.0f} times the noise, and motor friction does not explain "
        "it. Damping may be biased, and stiffness applies to this amplitude only. Check that channels, units, time and "
        f"load are the same in all records. If they are, {cure}"
    )
    return (Note(UNEXPLAINED, text, f"configuration {response.configuration.name}"),)


def _arm_variance(
    net: Sequence[Record], response: Response, spec: EstimatorSpec, planned_lines: IntArray | None, robot: Robot | None
) -> FloatArray | float:
    """Return the variance (F, n_y, n_u) of G by the nominal arm's nonlinear motion, in rows of motors; 0 if unknown."""
    from elastid.fit.parameter_selection import choose  # these bring CasADi
    from elastid.fit.spec import FitSpec
    from elastid.linear.linearise import Linearisation
    from elastid.nonlinear.period_lines import gather_lines
    from elastid.nonlinear.period_model import drive_lines, without_arm

    if robot is None or set(response.inputs) != set(robot.motor_locations):
        return 0.0
    first = [record for record in net if record.realisation == net[0].realisation]
    try:
        lines, parameters = gather_lines(first, spec, planned_lines), choose(FitSpec(), robot)
        drive = drive_lines(lines, Linearisation.of_robot(robot), response, parameters, parameters.x)
        Y = without_arm(lines, drive, robot).Y - lines.Y
    except (DataError, StudyError):
        return 0.0
    index = np.rint(response.freq_hz / lines.freq_hz[0]).astype(np.int64) - 1
    G = Y[index] * lines.s[index, None, None] ** MOTION_ORDER[response.quantity] @ np.linalg.pinv(lines.U[index])
    variance = np.zeros(response.G.shape)
    variance[:, [response.outputs.index(location) for location in response.inputs]] = np.abs(G) ** 2
    return variance / len({record.realisation for record in net})


def _coefficient_errors(
    data: ConfigurationSpectra, rate_hz: float, friction: CompensatedFriction, response: Response, E: FloatArray | None
) -> ComplexArray:
    """Return delta G (n_b, n_u, F, n_y, n_u) of each motor, by its coefficients in order of size and its reversals."""
    locations, n_u = friction.places, len(friction.places)
    coupling = np.eye(n_u) if E is None else E
    motor_of = np.array([locations.index(shape.place) for shape in friction.shapes])
    on, net = data.excited, data.U - compensation_torque(friction.coulomb_torque, data.Phi, motor_of, n_u)
    pseudo = np.linalg.pinv(net[on]) @ np.linalg.inv(coupling.T)
    lines = np.rint(response.freq_hz / data.freq_hz[0] * data.lines[0]).astype(np.int64)
    factors = [_factors(friction.covariance * np.outer(motor_of == j, motor_of == j)) for j in range(n_u)]
    errors = np.zeros((1 + max(L.shape[1] for L in factors), n_u, *response.G.shape), complex)
    delay = laplace_variable(data.freq_hz[on, None]) * (TURNING_ERROR / rate_hz)
    for j, L in enumerate(factors):
        coulomb_errors = np.einsum("fik,ib->fbk", data.Phi[on], L)
        reversal_errors = delay * np.einsum("fik,i->fk", data.Phi[on], friction.coulomb_torque * (motor_of == j))
        patterns = np.concatenate([coulomb_errors, reversal_errors[:, None]], axis=1)
        rows = interpolate(lines, data.lines[on], patterns @ pseudo)
        errors[: patterns.shape[1], j] = (response.G @ coupling[j])[:, :, None] * rows.swapaxes(0, 1)[:, :, None, :]
    return errors


def _factors(C: FloatArray) -> FloatArray:
    """Return L (n, n_b) of C = L L^T (n, n), largest columns first, without columns below 1e-4 of the largest."""
    power, V = np.linalg.eigh(C)
    large = np.flatnonzero(power > 1e-4**2 * power[-1])[::-1]
    return np.asarray(V[:, large] * np.sqrt(power[large]))
