r"""Channel errors of signals, :math:`F = g\, e^{-s T_d} / (1 + s T_l)`, and their inverse.

By FFT of the record, extended at both ends by odd reflection, without the line between the ends of the extension: exact
on the DFT lines of a periodic record, except for samples near its ends.
"""

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.robot.measurement_chain import Channel, low_pass_response

_EDGE_SAMPLES = 2048  # extension at each end; the error of a delayed step is inversely proportional to it


def log_signal(signals: FloatArray, rate_hz: float, channels: Sequence[Sequence[Channel]]) -> FloatArray:
    """Return signals (n, c) as logged at rate_hz; channels: in series for each column, possibly none."""
    return _apply(signals, rate_hz, channels, 1)


def before_channels(signals: FloatArray, rate_hz: float, channels: Sequence[Sequence[Channel]]) -> FloatArray:
    """Return the true signals (n, c) of logged signals, the inverse of `log_signal`."""
    return _apply(signals, rate_hz, channels, -1)


def _apply(signals: FloatArray, rate_hz: float, channels: Sequence[Sequence[Channel]], power: int) -> FloatArray:
    if not any(channels):
        return signals
    return np.stack([_filter(x, rate_hz, chain, power) for x, chain in zip(signals.T, channels, strict=True)], axis=1)


def _filter(x: FloatArray, rate_hz: float, channels: Sequence[Channel], power: int) -> FloatArray:
    gain = float(np.prod([channel.gain**power for channel in channels]))
    delays = [channel for channel in channels if channel.delay or channel.low_pass]
    if not delays or len(x) < 2:
        return x * gain
    lag_s = power * sum(channel.delay + channel.low_pass for channel in delays)
    m = min(len(x) - 1, _EDGE_SAMPLES)
    extended = np.pad(x, m, mode="reflect", reflect_type="odd")
    slope = (extended[-1] - extended[0]) / (len(extended) - 1)
    line = extended[0] + slope * np.arange(len(extended))
    s = laplace_variable(np.fft.rfftfreq(len(extended), 1 / rate_hz))
    H: ComplexArray = np.prod([_response(s, channel) ** power for channel in delays], axis=0)
    result = np.fft.irfft(np.fft.rfft(extended - line) * H, len(extended)) + line - slope * rate_hz * lag_s
    return np.asarray(gain * result[m : m + len(x)])


def _response(s: ComplexArray, channel: Channel) -> ComplexArray:
    """Return response (F,) of delay and low pass of a channel."""
    return np.exp(-s * channel.delay) * low_pass_response(s, channel.low_pass)
