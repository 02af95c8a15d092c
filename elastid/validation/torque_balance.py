r"""The torque of a log part by part, for the motion as it was measured.

.. math:: u(t) = \sum_i \tau_i(t) + e(t), \qquad
          share_i = \overline{\tau_i u} \,/\, \overline{u^2}, \qquad left = \overline{e^2} \,/\, \overline{u^2}

tau_i: the torque that a part of the model takes for the *measured* motion, so that no controller and no stability is
needed. Shares do not depend on the order of the parts, and together with that of e they sum to 1. Parts that work
against each other have more than 1 and less than 0: above an antiresonance a spring takes the link's inertia back.
Over frequency the same with spectra U, T_i of Hann's window, summed over the lines of a band (Parseval).

Of a multisine, at the lines of the response in the last period of the steady state, where this is exact:

.. math:: \hat U = G_m^{-1} Y_m, \qquad G_m: \text{torques of the motors to their own motion}

of three models with the fitted numbers: springs left out and no viscous friction (rigid body), with springs (elasticity
is the difference), and with viscous friction (the same). Dry friction is what the estimator took out of the torque.
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
    location: str,
    log: str,
    unit: str,
    rate_hz: float,
    measured: FloatArray,
    parts: Mapping[str, FloatArray],
    band_hz: tuple[float, float],
    has_rate: bool = True,
) -> TorqueBalance:
    """Return shares of the parts (n,) in the measured torque (n,), over all and in octaves below the end of band_hz."""
    names, torques = tuple(parts), np.stack(list(parts.values()))
    dry = np.array([name not in FRICTION for name in names])
    fractions, ratio, without = _explained(measured[None], torques[:, None], dry)
    window = np.hanning(len(measured) + 1)[:-1]
    U, T = np.fft.rfft(window * measured), np.fft.rfft(window * torques)
    octaves = list(octave_lines(band_hz, rate_hz, len(measured)))
    power = [float(np.sum(np.abs(U[inside]) ** 2)) for _, _, inside in octaves]
    total = max(sum(power), 1e-300)
    bands = tuple(
        BandBalance(low, high, component / total, *_explained(U[inside], T[:, inside], dry))
        for component, (low, high, inside) in zip(power, octaves, strict=True)
    )
    header = location, log, unit, rate_hz, names, measured, torques
    return TorqueBalance(*header, fractions, ratio, without, bands, has_rate)


def octave_lines(band_hz: tuple[float, float], rate_hz: float, n: int) -> Iterator[tuple[float, float, BoolArray]]:
    """Yield octaves of band_hz upwards from its bottom: ends, Hz, and flags (n // 2 + 1,) of lines of a DFT of n."""
    low, high = band_hz
    edges = [high]
    # Below four lines, those of the window, a band is that of a neighbour.
    while edges[-1] / 2 > max(2 * low, 4 * (rate_hz / n)):
        edges.append(edges[-1] / 2)
    if low < edges[-1]:
        edges.append(low)
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz)
    for first, last in pairwise(reversed(edges)):
        yield first, last, (freq_hz >= first) & (freq_hz < last)


def _explained(
    measured: FloatArray | ComplexArray, torques: FloatArray | ComplexArray, no_friction: FloatArray
) -> tuple[tuple[float, ...], float, float]:
    """Return power fractions of torques (n_p, ...), and of the residuals with and without friction."""
    u, parts = measured.ravel(), torques.reshape(len(torques), -1)
    power = max(float(np.sum(np.abs(u) ** 2)), 1e-300)
    ratio, without = (float(np.sum(np.abs(u - part.sum(axis=0)) ** 2)) / power for part in (parts, parts[no_friction]))
    return tuple(((parts @ u.conj()).real / power).tolist()), ratio, without


# A model of the motors' own motion in one configuration, and its numbers (n_theta,).
Part: TypeAlias = tuple[LinearModel, FloatArray]


def rigid_linearisation(fitted: FittedRobot, spec: ModelSpec = EXACT) -> Linearisation:
    """Return the fitted robot without its springs, to be linearised; StudyError where it cannot be without them."""
    names = [coordinate.name for coordinate in elastic_coordinates(fitted.robot)]
    return Linearisation.of_robot(with_stiff_joints(fitted.robot, names), spec, fitted.result.parameters.names)


def model_parts(fitted: FittedRobot, rigid: Linearisation, configuration: str) -> Sequence[Part] | None:
    """Return the robot as fitted, without viscous friction, and without springs either.

    None where the motion of a motor was not measured.
    """
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
    record: Record, net: Record, parts: Sequence[Part], freq_hz: FloatArray, spec: EstimatorSpec
) -> tuple[TorqueBalance, ...]:
    """Return balances of each motor at freq_hz (F,), none if fewer than two periods settled; net: no dry friction."""
    # Periods that count: neither dropped by the study nor left out by the repair of the log.
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
    """Return Y (1, F, n_y), U (1, F, n_u) of the last period of a record that was not left out."""
    last = [last_counted(record.n_samples // record.repeat_samples, record.discarded_periods)]
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    spectra, n_y = RecordSpectra(record), len(record.outputs)
    Y, U = (spectra.amplitudes(role, lines)[last] for role in ("y", "u"))
    scale = unit_scale(record, freq_hz, quantity)
    return Y * scale[:, :n_y], U * scale[:, n_y:]


def last_counted(periods: int, left_out: Collection[int]) -> int:
    """Return the last period that is not left out; the last one where all are."""
    return max((p for p in range(periods) if p not in left_out), default=periods - 1)
