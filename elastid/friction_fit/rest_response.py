"""Displacement per torque of one place at standstill under a small multisine, one response for each amplitude."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.friction_record import FrictionRecord
from elastid.record import Configuration, Record

# The highest excited line times this is the band in which the place is taken to move; above, an encoder's noise is.
MOTION_BAND = 1.5
# Half of the swing of the position, in counts of its encoder, below which a response says nothing of bristles.
MIN_COUNTS = 3.0
# Amplitudes nearer than this ratio are one: of one peak, random phases make different ones.
SAME_AMPLITUDE = 1.4
# Lines of the torque that must stand out of noise.
MIN_LINES = 8


@frozen_value
class RestResponse:
    """Receptance G (F,), rad/Nm at freq_hz (F,), with the variance E|dG|^2 (F,) by noise, at one amplitude.

    torque: peak, Nm.  rms_position, rms_velocity: of the whole motion, noise included, rad and rad/s.
    """

    freq_hz: FloatArray
    G: ComplexArray
    variance: FloatArray
    torque: float
    rms_position: float
    rms_velocity: float

    @classmethod
    def of(cls, records: Sequence[FrictionRecord]) -> RestResponse:
        """From the periodic records of one amplitude, each a realisation.

        Raises DataError for a record without a period and where the place moves by less than a few counts of its
        encoder, and as `estimate` does.
        """
        first, periodic = records[0], [_periodic(record, i) for i, record in enumerate(records)]
        reach = float(np.mean([np.ptp(_mean_period(record, record.y)) / 2 for record in periodic]))
        if not reach > MIN_COUNTS * first.resolution:
            raise DataError(
                f"joint {first.joint} at rest ({first.name}): it moves by {reach:.3g} {first.unit}, "
                f"{reach / first.resolution:.2g} counts of its encoder; a response takes {MIN_COUNTS:g}: raise the "
                "torque at rest, use a finer encoder, or measure presliding by loops"
            )
        found = estimate(periodic, EstimatorSpec(quantity="position", friction="none"))
        assert found.noise is not None
        if found.n_lines < MIN_LINES:
            raise DataError(
                f"joint {first.joint} at rest ({first.name}): {found.n_lines} lines of its torque stand out of the "
                f"noise, {MIN_LINES} are needed: raise the torque at rest, or repeat its period more often"
            )
        position, velocity = _motion(periodic, MOTION_BAND * float(found.freq_hz[-1]), first.resolution)
        peak = max(float(np.ptp(_mean_period(record, record.u))) / 2 for record in periodic)
        return cls(found.freq_hz, found.G[:, 0, 0], found.noise.variance[:, 0, 0], peak, position, velocity)


def rest_responses(records: Sequence[FrictionRecord]) -> tuple[RestResponse, ...]:
    """One response for each amplitude of the torque, the smallest first."""
    sizes = sorted(((_size(record), record) for record in records), key=lambda each: each[0])
    groups: list[list[FrictionRecord]] = []
    last = 0.0
    for size, record in sizes:
        if size > SAME_AMPLITUDE * last:
            groups.append([])
        groups[-1].append(record)
        last = size
    return tuple(RestResponse.of(group) for group in groups)


def _periodic(record: FrictionRecord, realisation: int) -> Record:
    """The same as a record of a frequency response."""
    if record.period_samples is None:
        raise DataError(
            f"joint {record.joint} at rest ({record.name}): its torque has no period; repeat a multisine, and state "
            "its period"
        )
    place = (f"motor {record.joint}",)
    return Record(
        record.name, record.configuration or Configuration(record.name, np.zeros(1)), realisation, 0, record.rate_hz,
        record.period_samples, place, place, ("position",), record.torque[:, None], record.position[:, None],
        hold=record.hold, sliding=place if record.slides else (),
    )  # fmt: skip


def _size(record: FrictionRecord) -> float:
    """Rms of the periodic part of the torque, free of noise: by the first and the second half of its periods."""
    n = record.period_samples or len(record.torque)
    periods = record.torque[: len(record.torque) // n * n].reshape(-1, n)
    if len(periods) < 2:
        return float(np.std(record.torque))
    first, second = (part.mean(axis=0) - part.mean() for part in np.array_split(periods, 2))
    return float(np.sqrt(max(np.mean(first * second), 0.0)))


def _mean_period(record: Record, signal: FloatArray) -> FloatArray:
    """The mean (period_samples,) over whole periods but the first, where there are more."""
    P, n = record.n_periods, record.period_samples
    periods = signal[: P * n, 0].reshape(P, n)
    return np.asarray(periods[min(1, P - 1) :].mean(axis=0))


def _motion(records: Sequence[Record], band_hz: float, resolution: float) -> tuple[float, float]:
    """Rms position and velocity below band_hz, less what an encoder's counts add; without mean and drift."""
    powers = []
    for record in records:
        q = record.y[record.period_samples if record.n_periods > 1 else 0 :, 0]
        n = len(q)
        freq_hz = np.fft.rfftfreq(n, 1 / record.rate_hz)
        power = 2 * np.abs(np.fft.rfft(q * np.sqrt(2 / 3) * (1 - np.cos(2 * np.pi * np.arange(n) / n)))) ** 2 / n**2
        # One period at least fits into what counts as motion.
        inside = (freq_hz > 0.75 * record.rate_hz / record.period_samples) & (freq_hz < band_hz)
        power = power[inside] - resolution**2 / 6 / n
        powers.append([power.sum(), np.sum((2 * np.pi * freq_hz[inside]) ** 2 * power)])
    position, velocity = np.sqrt(np.maximum(np.mean(powers, axis=0), 1e-300))
    return float(position), float(velocity)
