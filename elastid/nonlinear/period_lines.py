r"""Mean periods of a configuration's records on all DFT lines, excited or not; their fine grid.

The linear model of a configuration on all lines of its periods: how forces in the drivetrain move the robot.

.. math:: Z(s)\, q = B u - \sum_i f_i P_i \Phi_i, \qquad Z = s^2 M + s D + K, \qquad H = Z^{-1}

P_i: the motor's coordinate, the link's, or the deflection of the gear, as rows in the model's coordinates.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.fft import irfft, rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.excitation.grids import line_frequencies
from elastid.fit.problem.elastic import kernel_of, linear_model
from elastid.frf.lines import analysed_lines, spectra_of
from elastid.frf.period_selection import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, period_spectra, single_logs
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import DELAY, TORQUE_LAG, LinearModel
from elastid.linear.linearise import Linearisation
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import factor
from elastid.model.drivetrain import input_matrix, spring_deflections
from elastid.nonlinear.effects import Place
from elastid.nonlinear.motion import CELLS
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER, Configuration, Record
from elastid.response import Response

_ROUNDING = 1e-12  # of the largest angle


@dataclass(frozen=True, eq=False)
class PeriodLines:
    """Amplitudes of M experiments of one configuration at lines 1 to F: torques U (F, n_u, M), angles Y (F, n_u, M).

    Y of the motors that U acts on, in their order, rad on the link side.  mean, load (n_u, M): mean angles and torques,
    of whole periods.  noise (n_u,):
    variance of the noise of an element of Y that does not fall with frequency.  scatter (F, n_u): variance of the mean
    over the periods, of Y.  excited (F,).  samples: of a period.
    count (n_u,): smallest step of an angle.  arm (F + 1, n_j, M): torques of the links, and their mean first, whose
    motion is taken out of Y; 0 if none.
    """

    configuration: Configuration
    rate_hz: float
    samples: int
    U: ComplexArray
    Y: ComplexArray
    mean: FloatArray
    load: FloatArray
    noise: FloatArray
    scatter: FloatArray
    excited: BoolArray
    realisation: IntArray
    count: FloatArray
    arm: ComplexArray | None = None

    @property
    def points(self) -> int:
        """Of the fine grid."""
        return self.samples * CELLS

    @cached_property
    def freq_hz(self) -> FloatArray:
        """Frequencies (F,)."""
        return line_frequencies(np.arange(1, len(self.U) + 1), self.rate_hz, self.samples)

    @cached_property
    def s(self) -> ComplexArray:
        """j omega (F,)."""
        return np.asarray(2j * np.pi * self.freq_hz)

    def fine(self, X: ComplexArray) -> FloatArray:
        """The signals (..., n) of amplitudes (..., F) on the fine grid of a period."""
        n = self.points
        padded = np.zeros((*X.shape[:-1], n // 2 + 1), complex)
        padded[..., 1 : X.shape[-1] + 1] = X
        return np.asarray(irfft(padded, n) * (n / 2))

    def amplitudes(self, x: FloatArray) -> ComplexArray:
        """Amplitudes (..., F) of signals (..., n) on the fine grid."""
        return np.asarray(rfft(x)[..., 1 : len(self.U) + 1] * (2 / x.shape[-1]))


def gather_lines(measured: Iterable[Record], spec: EstimatorSpec, planned: IntArray | None) -> PeriodLines:
    """The mean over the periods that can be trusted, of the records of one configuration.

    Raises DataError and StudyError as `analysed_lines` does; DataError where the angle of an excited motor is missing.
    """
    records = tuple(log for record in measured for log in single_logs(record))
    first = records[0]
    if not first.is_periodic:
        raise DataError(
            "gears/records",
            "the records have no period; what gears do is found from the "
            "lines of a periodic excitation, those between the excited ones among them",
            f"configuration {first.configuration.name}",
        )
    missing = [place for place in first.inputs if place not in first.outputs]
    if missing:
        raise DataError(
            "gears/records",
            f"the angle of {', '.join(missing)} is not among the outputs; "
            "what a gear does is found from the motion of its motor: log it",
            f"configuration {first.configuration.name}",
        )
    columns = [first.outputs.index(place) for place in first.inputs]
    excited = analysed_lines(spectra_of(records, spec, planned), spec, planned)
    lines = np.arange(1, (first.period_samples + 1) // 2)
    periods = [_periods(record, lines, np.isin(lines, excited), spec) for record in records]
    U = np.stack([each.U.mean(axis=0) for each in periods], axis=2)
    of_periods = [each.Y[:, :, columns] for each in periods]
    repeated = [Y.var(axis=0, ddof=1) / len(Y) for Y in of_periods if len(Y) > 1]
    # Of a single period the highest lines show noise, where a robot barely moves.
    scatter = np.mean(repeated if repeated else [np.abs(Y[0]) ** 2 for Y in of_periods], axis=0)
    logged = np.array([first.quantities[i] == "position" for i in columns])
    return PeriodLines(
        first.configuration,
        first.rate_hz,
        first.period_samples,
        U,
        np.stack([Y.mean(axis=0) for Y in of_periods], axis=2),
        np.stack([np.where(logged, record.y[:, columns].mean(axis=0), 0.0) for record in records], axis=1),
        np.stack([record.u[: record.n_periods * record.period_samples].mean(axis=0) for record in records], axis=1),
        np.mean(scatter[int(7 / 8 * len(scatter)) :], axis=0),
        scatter,
        np.isin(lines, excited),
        np.array([record.realisation for record in records]),
        np.array([_smallest_step(first.y[:, column]) for column in columns]),
    )


def _smallest_step(y: FloatArray) -> float:
    """Between the values of y (n,), a count of an encoder; next to nothing where noise or arithmetic is added to it."""
    steps = np.diff(np.unique(y))
    steps = steps[steps > _ROUNDING * np.abs(y).max()]
    return float(steps.min()) if steps.size else 0.0


def _periods(record: Record, lines: IntArray, excited: BoolArray, spec: EstimatorSpec) -> PeriodSpectra:
    """Angles and torques of the periods that can be trusted, by their excited lines (F,), at all lines."""
    every = period_spectra(RecordSpectra(replace(record, half_wave=False)), lines, "position")
    return every.only(trusted(every.on(excited), spec).periods) if len(every.periods) > 1 else every


@dataclass(frozen=True, eq=False)
class DriveLines:
    """H (F, n, n), C (n_u, n) of the motors' angles, G (F, n_u, n_u) of the logged ones with images of held torque.

    command (F, n_u): the torque that acts over the one that was logged.  sensor (F, n_u): logged angle over the true
    one.  images (F, n_u, n_u): what G has beyond sensor C H B command.  joints (n_j,): those that are driven, with the
    turns `ratios` (n_j,) of motors for one of theirs.  places: their rows (n_j, n) of motors, gears and links.
    k, d, torque (n_j,): of their springs, and what these bear at rest; of a gear without a spring of its own 1, 0 and
    0, which deflects by nothing.  chain (P, n_x): d theta / d x of the parameters
    `kernel.wanted`.
    """

    model: LinearModel
    kernel: Kernel
    theta: FloatArray
    H: ComplexArray
    C: FloatArray
    B: FloatArray
    G: ComplexArray
    images: ComplexArray
    command: ComplexArray
    sensor: ComplexArray
    joints: tuple[str, ...]
    ratios: FloatArray
    places: dict[Place, FloatArray]
    k: FloatArray
    d: FloatArray
    torque: FloatArray
    chain: FloatArray

    def directions(self, place: Place, joint: int) -> FloatArray:
        """Row (n,) of a place at a joint."""
        return np.asarray(self.places[place][joint])

    def moved(self, place: Place, joint: int, U: ComplexArray) -> ComplexArray:
        """Its motion (F, M) by torques (F, n_u, M) that were logged, in the linear model."""
        q = self.H @ (self.B @ (self.command[:, :, None] * U))
        return np.asarray(np.tensordot(self.directions(place, joint), q, axes=(0, 1)))

    def motor_row(self, joint: int) -> FloatArray:
        """Angle of a motor by the logged angles (n_u,)."""
        return np.asarray(self.directions("motor", joint) @ np.linalg.pinv(self.C))


def elastic_joints(linearisation: Linearisation) -> tuple[str, ...]:
    """Names of the driven joints with a spring of their own in the gear."""
    springs = spring_deflections(linearisation.model.robot)
    return tuple(joint.name for joint in linearisation.model.robot.driven if f"k_{joint.name}" in springs)


def drive_lines(
    lines: PeriodLines,
    linearisation: Linearisation,
    response: Response,
    parameters: Parameters,
    x: FloatArray,
) -> DriveLines:
    """The model at x (n_x,); response: as fitted, of the same configuration, whose inputs have all their motors."""
    robot, name = linearisation.model.robot, lines.configuration.name
    theta = parameters.expand(x, name)
    motors = [response.outputs.index(place) for place in response.inputs]
    model = linear_model(linearisation, response, theta)
    kernel = kernel_of(model.with_outputs(motors), parameters, lines.freq_hz)
    M, D, K = model.matrices(theta)
    s = lines.s[:, None, None]
    H = np.asarray(np.linalg.inv(s**2 * M + s * D + K), np.complex128)
    C = model.with_outputs(motors).C
    of_outputs, of_inputs = kernel.model.channel_gains(theta)
    order = MOTION_ORDER[model.quantity]

    elements = (element for element in kernel.model.chain if element.name != TORQUE_LAG)
    lags = (element.response(lines.s, kernel.model.number(theta, element.name)) for element in elements)
    lag = np.prod([np.ones(len(lines.s), complex), *lags], axis=0)  # of the sensors
    sensor = lag[:, None] * of_outputs
    command = (factor(kernel.model, theta, lines.s) / lines.s**order / lag)[:, None] * of_inputs
    G = kernel.response(theta) / s**order
    images = G - sensor[:, :, None] * (C @ H @ model.B) * command[:, None, :]
    springs, driven = spring_deflections(robot), tuple(joint.name for joint in robot.driven)
    ratios = np.array([robot.ratio(joint) for joint in driven])
    of_model = model.Z if model.Z is not None else np.eye(model.n)
    n_q = of_model.shape[0]
    rows: dict[Place, FloatArray] = {
        "motor": robot.mixing @ input_matrix(robot).T,
        "gear": np.array([springs.get(f"k_{joint}", np.zeros(n_q)) for joint in driven]),
        "link": np.eye(n_q)[list(robot.driven_indices)],
    }
    numbers = dict(zip(model.parameters, theta, strict=True))
    k = np.array([numbers[f"k_{joint}"] if f"k_{joint}" in springs else 1.0 for joint in driven])
    d = np.array([numbers[f"d_{joint}"] if f"k_{joint}" in springs else 0.0 for joint in driven])
    rest = equilibrium(linearisation.model, theta[: -1 if DELAY in model.parameters else None], lines.configuration)
    places = {place: row @ of_model for place, row in rows.items()}
    chain = parameters.jacobian(x, name)[kernel.places]
    torque = k * (rows["gear"] @ rest.q)
    of_joints = driven, ratios, places, k, d, torque
    return DriveLines(model, kernel, theta, H, C, model.B, G, images, command, sensor, *of_joints, chain)
