"""The making of faults of a measurement, each a function that changes a copy of the true one."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from scipy.ndimage import shift
from scipy.signal import lfilter

from elastid.base.arrays import FloatArray
from plants.injected_measurement import RATE_HZ, Log, Measurement

Fault: TypeAlias = Callable[[Measurement], None]


def signal(name: str, motor: int | None, by: Callable[[FloatArray], FloatArray]) -> Fault:
    """A signal in every log through a function of its samples."""

    def of(measurement: Measurement) -> None:
        for log in measurement.logs:
            log.change(name, motor, by)

    return of


def gain(name: str, motor: int | None, factor: float) -> Fault:
    return signal(name, motor, lambda x: factor * x)


def late(name: str, motor: int | None, samples: float) -> Fault:
    """A whole number of samples; other ones are within the band of the excitation by a spline of the fifth order."""
    return signal(name, motor, lambda x: np.asarray(shift(x, samples, order=5, mode="nearest")))


def low_pass(name: str, motor: int | None, corner_hz: float) -> Fault:
    """A first-order filter, started at rest on its first sample."""
    pole = np.exp(-2 * np.pi * corner_hz / RATE_HZ)
    return signal(name, motor, lambda x: x[0] + np.asarray(lfilter([1 - pole], [1, -pole], x - x[0])))


def noisy(name: str, motor: int | None, std: float) -> Fault:
    random = np.random.default_rng(5)
    return signal(name, motor, lambda x: x + std * random.standard_normal(len(x)))


def hum(name: str, motor: int | None, amplitude: float) -> Fault:
    return signal(name, motor, lambda x: x + amplitude * np.sin(2 * np.pi * 50.0 * np.arange(len(x)) / RATE_HZ + 0.3))


def clip(name: str, motor: int, share: float) -> Fault:
    return signal(name, motor, lambda x: np.clip(x, share * x.min(), share * x.max()))


def rounded(name: str, motor: int | None, step: float) -> Fault:
    return signal(name, motor, lambda x: step * np.round(x / step))


def drifting_gain(name: str, motor: int | None, by: float) -> Fault:
    return signal(name, motor, lambda x: x * np.linspace(1.0, 1.0 + by, len(x)))


def ramp(name: str, motor: int | None, by: float) -> Fault:
    return signal(name, motor, lambda x: x + np.linspace(0.0, by, len(x)))


def spikes(name: str, motor: int, count: int, size: float) -> Fault:
    """So many samples far off, by a multiple of the signal's spread."""
    random = np.random.default_rng(6)

    def of(x: FloatArray) -> FloatArray:
        spoilt = x.copy()
        spoilt[random.integers(len(x), size=count)] += size * x.std()
        return spoilt

    return signal(name, motor, of)


def stuck(name: str, motor: int, samples: int, value: float | None = None) -> Fault:
    """A stretch that repeats its first sample, or holds a value."""

    def of(x: FloatArray) -> FloatArray:
        spoilt, first = x.copy(), len(x) // 3
        spoilt[first : first + samples] = x[first] if value is None else value
        return spoilt

    return signal(name, motor, of)


def crosstalk(name: str, share: float) -> Fault:
    """So much of the signal of motor 1 is in that of motor 2."""

    def of(measurement: Measurement) -> None:
        for log in measurement.logs:
            values = log.signals[name].copy()
            values[:, 1] += share * values[:, 0]
            log.signals[name] = values

    return of


def exchanged(*names: str) -> Fault:
    """The cables of both motors."""

    def of(measurement: Measurement) -> None:
        for log in measurement.logs:
            log.signals |= {name: log.signals[name][:, ::-1].copy() for name in names}

    return of


def channel(role: str, motor: int | None, **keys: Any) -> Fault:
    """Keys of channels in the study."""

    def of(measurement: Measurement) -> None:
        for channel in measurement.recorded["channels"]:
            if channel["role"] == role and motor in (None, int(channel["at"][-1])):
                channel.update(keys)

    return of


def recorded(**keys: Any) -> Fault:
    return lambda measurement: measurement.recorded.update(keys)


def body(name: str, **factors: float) -> Fault:
    """Numbers of a body in the robot's file times factors."""

    def of(measurement: Measurement) -> None:
        body = measurement.body(name)
        for key, factor in factors.items():
            body[key] = np.multiply(factor, body[key]).tolist()

    return of


def centre(name: str, *by: float) -> Fault:
    """The centre of mass moved by so many metres."""

    def of(measurement: Measurement) -> None:
        body = measurement.body(name)
        body["center_of_mass"] = np.add(by, body["center_of_mass"]).tolist()

    return of


def motor(number: int, **factors: float) -> Fault:
    def of(measurement: Measurement) -> None:
        motor = measurement.motor(number)
        motor.update({key: factor * motor[key] for key, factor in factors.items()})

    return of


def rigid(joint: str) -> Fault:
    """A joint that the robot's file does not have as elastic."""

    def of(measurement: Measurement) -> None:
        for body in measurement.robot["bodies"]:
            body["joints"] = [each for each in body["joints"] if str(each["name"]) != joint]

    return of


def posture(name: str, *by: float) -> Fault:
    """The angles of a posture in the study, so many degrees off."""

    def of(measurement: Measurement) -> None:
        angles = measurement.study["experiment"]["configurations"]
        angles[name] = np.add(np.deg2rad(by), angles[name]).tolist()

    return of


def postures(by: Callable[[dict[str, list[float]]], dict[str, list[float]]]) -> Fault:
    def of(measurement: Measurement) -> None:
        experiment = measurement.study["experiment"]
        experiment["configurations"] = by(experiment["configurations"])

    return of


def samples(of_log: Callable[[int], Any], number: int | None = None) -> Fault:
    """Some of the samples alone, of one log or of all, as a function of their number."""

    def of(measurement: Measurement) -> None:
        for log in measurement.logs if number is None else [measurement.logs[number]]:
            log.rows(of_log(len(log.signals["t"])))

    return of


def without(count: int) -> Callable[[int], Any]:
    """All samples but so many in the middle."""
    return lambda n: np.delete(np.arange(n), np.arange(n // 2, n // 2 + count))


def twice(count: int) -> Callable[[int], Any]:
    """So many samples in the middle twice."""
    return lambda n: np.insert(np.arange(n), n // 2, np.arange(n // 2 - count, n // 2))


def stretched(factor: float) -> Fault:
    """The logger's clock is so much faster than it says, within the band of the excitation."""

    def of(measurement: Measurement) -> None:
        for log in measurement.logs:
            n = len(log.signals["t"])
            at = np.arange(n) / factor
            for name in ("u", "y"):
                log.change(name, None, lambda x, at=at, n=n: np.interp(at, np.arange(n), x))

    return of


def logs(by: Callable[[list[Log]], list[dict[str, FloatArray]]]) -> Fault:
    """Other contents under the names of the logs."""

    def of(measurement: Measurement) -> None:
        for log, signals in zip(measurement.logs, by(measurement.logs), strict=True):
            log.signals = signals

    return of


def reference_as_torque(measurement: Measurement) -> None:
    """The channel of the torque holds the excitation of a loop that was closed."""
    for log in measurement.logs:
        log.signals["u"] = log.signals["r"]


def together(*faults: Fault) -> Fault:
    def of(measurement: Measurement) -> None:
        for fault in faults:
            fault(measurement)

    return of


def eccentric(amplitude: float) -> Fault:
    """An encoder disc off its centre: an error once a turn of the motor, whose ratio is 6, on the link side."""
    return signal("y", 1, lambda x: x + amplitude * np.sin(6.0 * x))


def deadband(name: str, motor: int, width: float) -> Fault:
    return signal(name, motor, lambda x: np.sign(x) * np.maximum(np.abs(x) - width, 0.0))


def saturating(by: float) -> Fault:
    """A torque constant that falls with the current: at three times its spread the torque reads so much too high."""
    return signal("u", 1, lambda x: x * (1 + by * (x / (3 * x.std())) ** 2))


def wrapped(name: str, motor: int, turn: float) -> Fault:
    return signal(name, motor, lambda x: (x + turn / 2 - x.mean()) % turn - turn / 2)


def nothing(measurement: Measurement) -> None:
    """The true measurement."""
