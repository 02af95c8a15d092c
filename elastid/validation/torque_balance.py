r"""Torque balance of a log: components of the model's torque along the measured motion, by octave.

.. math:: u(t) = \sum_i \tau_i(t) + e(t), \qquad
          fraction_i = \overline{\tau_i u} \,/\, \overline{u^2}, \qquad
          unexplained = \overline{e^2} \,/\, \overline{u^2}

tau_i: torque of a component of the model along the *measured* motion, which needs no controller and no stability.
Fractions do not depend on the order of the components; with the fraction of e they sum to 1. Opposite components have
fractions above 1 and below 0: above an antiresonance a spring compensates the link's inertia. By octave, the fractions
are sums over the lines of spectra with Hann's window (Parseval).

The torque of a multisine is evaluated at the lines of the response in the last steady-state period, where it is exact:

.. math:: \hat U = G_m^{-1} Y_m, \qquad G_m: \text{from motor torques to motor motion}

Three models with the fitted numbers give the components: without springs and viscous friction (rigid body), with
springs (difference: elasticity) and with viscous friction (difference). Dry friction is the compensated torque.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, values_by_name
from elastid.excitation.grids import line_frequencies
from elastid.excitation.multisine import synthesise
from elastid.fit.fitted_robot import FittedRobot
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, unit_scale
from elastid.linear.linear_model import LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import DELAY
from elastid.record import Motion, Record
from elastid.robot.simplified import elastic_coordinates, with_stiff_joints
from elastid.validation.log_comparison import DRY, ELASTICITY, FRICTION, RIGID_BODY, VISCOUS, BandBalance, TorqueBalance


def torque_balance(
    location: str, log: str, unit: str, rate_hz: float, measured: FloatArray, parts: Mapping[str, FloatArray],
    band_hz: tuple[float, float], has_rate: bool = True
) -> TorqueBalance:  # fmt: skip
    """Return the balance of a measured torque (n,) and its components `parts` (n,), in total and by octave."""
    names, torques = tuple(parts), np.stack(list(parts.values()))
    is_no_friction = np.array([name not in FRICTION for name in names])
    fractions, ratio, ratio_without = _explained(measured[None], torques[:, None], is_no_friction)
    window = np.hanning(len(measured) + 1)[:-1]
    U, T = np.fft.rfft(window * measured), np.fft.rfft(window * torques)
    octaves = list(octave_lines(band_hz, rate_hz, len(measured)))
    power = [float(np.sum(np.abs(U[lines]) ** 2)) for _, _, lines in octaves]
    total = max(sum(power), 1e-300)
    bands = tuple(
        BandBalance(low, high, octave_power / total, *_explained(U[lines], T[:, lines], is_no_friction))
        for octave_power, (low, high, lines) in zip(power, octaves, strict=True)
    )
    header = location, log, unit, rate_hz, names, measured, torques
    return TorqueBalance(*header, fractions, ratio, ratio_without, bands, has_rate)


def octave_lines(band_hz: tuple[float, float], rate_hz: float, n: int) -> Iterator[tuple[float, float, BoolArray]]:
    """Yield the octaves of band_hz, upwards: ends, Hz, and flags (n // 2 + 1,) of the lines of a DFT of n samples."""
    low, high = band_hz
    edges = [high]
    # A band has at least four lines, the width of the window's main lobe.
    while edges[-1] / 2 > max(2 * low, 4 * (rate_hz / n)):
        edges.append(edges[-1] / 2)
    if low < edges[-1]:
        edges.append(low)
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz)
    for first, last in pairwise(reversed(edges)):
        yield first, last, (freq_hz >= first) & (freq_hz < last)


def _explained(
    measured: FloatArray | ComplexArray, torques: FloatArray | ComplexArray, is_no_friction: FloatArray
) -> tuple[tuple[float, ...], float, float]:
    """Return power fractions of torques (n_p, ...), and of the residuals with and without friction."""
    u, components = measured.ravel(), torques.reshape(len(torques), -1)
    power = max(float(np.sum(np.abs(u) ** 2)), 1e-300)
    sets = components, components[is_no_friction]
    ratio, ratio_without = (float(np.sum(np.abs(u - rows.sum(axis=0)) ** 2)) / power for rows in sets)
    return tuple(((components @ u.conj()).real / power).tolist()), ratio, ratio_without


# Model of the motor motion in one configuration, and its numbers (n_theta,).
MotorModel: TypeAlias = tuple[LinearModel, FloatArray]


def rigid_linearisation(fitted: FittedRobot, spec: ModelSpec = EXACT) -> Linearisation:
    """Return the linearisation of the fitted robot without springs; StudyError if it needs them."""
    names = [coordinate.name for coordinate in elastic_coordinates(fitted.robot)]
    return Linearisation.of_robot(with_stiff_joints(fitted.robot, names), spec, fitted.result.parameters.names)


def model_parts(fitted: FittedRobot, rigid: Linearisation, configuration: str) -> Sequence[MotorModel] | None:
    """Return the fitted model, without viscous friction, and also without springs; None if a motor was not measured."""
    model, theta = fitted.at(configuration).linear, fitted.theta_of(configuration)
    if not set(model.inputs) <= set(model.outputs):
        return None
    motors = model.with_outputs([model.outputs.index(index) for index in model.inputs])
    numbers = values_by_name(model.parameters, theta)
    free = numbers | {name: 0.0 for name, (_, path) in fitted.robot.numbers.items() if path[-1] == "viscous"}
    values = {name: value for name, (value, _) in rigid.model.robot.parameters().items()} | free
    rigid_theta = np.array([values[name] for name in (*rigid.model.parameters, DELAY)])
    alone = rigid.at(model.configuration, rigid_theta[:-1], motors.outputs, motors.quantity)
    columns = [alone.inputs.index(index) for index in motors.inputs]
    alone = replace(alone, B=alone.B[:, columns], inputs=motors.inputs, hold=motors.hold)
    return (motors, theta), (motors, np.array([free[name] for name in model.parameters])), (alone, rigid_theta)


def elastic_balances(
    record: Record, net: Record, parts: Sequence[MotorModel], freq_hz: FloatArray, spec: EstimatorSpec
) -> tuple[TorqueBalance, ...]:
    """Return the balance of each motor at freq_hz (F,), none for fewer than two valid periods; net: no dry friction."""
    # Periods are valid unless the study or the repair of the log discards them.
    dropped = 0 if spec.transient_periods == "auto" else spec.transient_periods
    if len({*range(dropped, record.n_samples // record.repeat_samples)} - {*record.discarded_periods}) < 2:
        return ()
    (motors, _), N = parts[0], record.period_samples
    lines = np.rint(freq_hz * N / record.rate_hz).astype(np.int64)
    (Y,), (U,) = last_period(record, lines, motors.quantity)
    (_,), (U_net,) = last_period(net, lines, motors.quantity)
    Y_m = Y[:, [record.outputs.index(index) for index in motors.outputs]]
    modelled = (frequency_response(*pair, freq_hz) for pair in parts)
    torques_of_models = (np.asarray(np.linalg.solve(G, Y_m[..., None])[..., 0]) for G in modelled)
    full, frictionless, rigid = (synthesise(lines, torque, N) for torque in torques_of_models)
    measured, dry = synthesise(lines, U, N), synthesise(lines, U - U_net, N)
    torques = {RIGID_BODY: rigid, ELASTICITY: frictionless - rigid, VISCOUS: full - frictionless, DRY: dry}
    band_hz = float(freq_hz[0]), float(freq_hz[-1]) * (1 + 1e-9)
    return tuple(
        torque_balance(
            index, record.name, record.units_of_inputs[i], record.rate_hz, measured[:, i],
            {name: torque[:, i] for name, torque in torques.items() if np.any(torque)}, band_hz, record.has_rate
        )
        for i, index in enumerate(motors.inputs)
    )  # fmt: skip


def last_period(record: Record, lines: IntArray, quantity: Motion) -> tuple[ComplexArray, ComplexArray]:
    """Return Y (1, F, n_y) and U (1, F, n_u) of the last valid period of a record."""
    last = [last_valid(record.n_samples // record.repeat_samples, record.discarded_periods)]
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    spectra, n_y = RecordSpectra(record), len(record.outputs)
    Y, U = (spectra.amplitudes(role, lines)[last] for role in ("y", "u"))
    scale = unit_scale(record, freq_hz, quantity)
    return Y * scale[:, :n_y], U * scale[:, n_y:]


def last_valid(periods: int, discarded: Collection[int]) -> int:
    """Return the index of the last period that is not discarded; the last one if all are."""
    return max((p for p in range(periods) if p not in discarded), default=periods - 1)
