r"""The torque of a log against its model, part by part: rigid body, friction, elasticity, and the residual.

.. math:: u(t) = \sum_i \tau_i(t) + e(t), \qquad
          share_i = \overline{\tau_i u} \,/\, \overline{u^2}, \qquad left = \overline{e^2} \,/\, \overline{u^2}

tau_i: the torque that a part of the model takes for the *measured* motion, so that no controller and no stability is
needed. Shares do not depend on the order of the parts, and together with that of e they sum to 1. Parts that work
against each other have more than 1 and less than 0: above an antiresonance a spring takes the link's inertia back.

Over frequency the same with spectra U, T_i of Hann's window, summed over the lines of a band (Parseval).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled

# Parts of a model's torque, as tables and figures name them; `FRICTION`: those that a model without friction lacks.
INERTIA, GRAVITY, RIGID_BODY, ELASTICITY = "inertia", "gravity and offset", "rigid body", "elasticity"
VISCOUS, DRY = "viscous friction", "dry friction"
FRICTION = (VISCOUS, DRY)
# An octave with less of the torque's power holds noise, or what the window leaks.
MIN_POWER_SHARE = 1e-4


@dataclass(frozen=True)
class BandBalance:
    """The torque between two frequencies in Hz: power, its share of all; share of each part in it; what is left.

    left_without_friction: by the model without its friction.
    """

    low_hz: float
    high_hz: float
    power: float
    shares: tuple[float, ...]
    left: float
    left_without_friction: float


@frozen_value
class TorqueBalance:
    """The torque of one motor in one log, link side.

    place: of its motor or joint.  log: name of the record.  unit: of the torque.  rate_hz: of the samples; without a
    known rate frequencies are in units of it.  parts: names; torques (n_p, n): of each.  measured (n,).
    shares: of each part in the mean square of the torque.  left: of it by the whole model, and left_without_friction by
    the model without its friction.  bands: the same by octave, upwards.  ValueError where shapes disagree.
    """

    place: str
    log: str
    unit: str
    rate_hz: float
    parts: tuple[str, ...]
    measured: FloatArray = labelled("torque as measured, link side", "{unit}", "sample")
    torques: FloatArray = labelled("torque of each part of the model", "{unit}", "parts sample")
    shares: tuple[float, ...]
    left: float
    left_without_friction: float
    bands: tuple[BandBalance, ...]
    rate_is_known: bool = True

    def __post_init__(self) -> None:
        """Check shapes."""
        if self.torques.shape != (len(self.parts), len(self.measured)):
            raise ValueError(f"torques of {len(self.parts)} parts have shape {self.torques.shape}")

    @property
    def worst(self) -> BandBalance:
        """The octave of which the model leaves most, of those with power."""
        return max((band for band in self.bands if band.power >= MIN_POWER_SHARE), key=lambda band: band.left)

    @property
    def residual(self) -> FloatArray:
        """Measured less modelled torque (n,)."""
        return np.asarray(self.measured - self.torques.sum(axis=0))

    def part(self, names: Sequence[str]) -> FloatArray:
        """The torque (n,) of these parts together, 0 of those that the model lacks."""
        return np.asarray(self.torques[[name in names for name in self.parts]].sum(axis=0))


def torque_balance(
    place: str,
    log: str,
    unit: str,
    rate_hz: float,
    measured: FloatArray,
    parts: Mapping[str, FloatArray],
    band_hz: tuple[float, float],
    rate_is_known: bool = True,
) -> TorqueBalance:
    """Shares of the parts (n,) in the measured torque (n,), over all and in octaves below the end of band_hz."""
    names, torques = tuple(parts), np.stack(list(parts.values()))
    dry = np.array([name not in FRICTION for name in names])
    shares, left, without = _explained(measured[None], torques[:, None], dry)
    window = np.hanning(len(measured) + 1)[:-1]
    U, T = np.fft.rfft(window * measured), np.fft.rfft(window * torques)
    octaves = list(octave_lines(band_hz, rate_hz, len(measured)))
    total = max(float(sum(np.sum(np.abs(U[inside]) ** 2) for _, _, inside in octaves)), 1e-300)
    bands = tuple(
        BandBalance(low, high, float(np.sum(np.abs(U[inside]) ** 2)) / total, *_explained(U[inside], T[:, inside], dry))
        for low, high, inside in octaves
    )
    return TorqueBalance(
        place, log, unit, rate_hz, names, measured, torques, shares, left, without, bands, rate_is_known
    )


def octave_lines(band_hz: tuple[float, float], rate_hz: float, n: int) -> Iterator[tuple[float, float, BoolArray]]:
    """Octaves below the top of band_hz, upwards, the lowest down to its bottom: ends, and lines of a DFT of n."""
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


def describe_balance(balance: TorqueBalance) -> str:
    """Shares of the parts, in two sentences."""
    pairs = list(zip(balance.parts, balance.shares, strict=True))
    rigid = [each for each in pairs if each[0] not in FRICTION]
    if not all(0 <= share <= 1 for _, share in rigid):  # they oppose each other, as about an antiresonance
        together = " and ".join(part for part, _ in rigid) + " together"
        pairs = [(together, sum(share for _, share in rigid)), *(each for each in pairs if each[0] in FRICTION)]
    shares = ", ".join(f"{part} {share:.1%}" for part, share in pairs)
    text = f"{balance.place}, {balance.log}: of the mean square of the torque {shares}; {balance.left:.1%} is left"
    if any(part in FRICTION for part in balance.parts):
        text += f" (without friction {balance.left_without_friction:.1%})"
    worst, unit = balance.worst, "Hz" if balance.rate_is_known else "of the sampling rate"
    return (
        f"{text}. By octaves most is left from {worst.low_hz:.3g} to {worst.high_hz:.3g} {unit}, where "
        f"{worst.power:.2%} of the torque's power lies: {worst.left:.0%} of that, without friction "
        f"{worst.left_without_friction:.0%}."
    )


def _explained(
    measured: FloatArray | ComplexArray, torques: FloatArray | ComplexArray, no_friction: FloatArray
) -> tuple[tuple[float, ...], float, float]:
    """Shares of torques (n_p, ...), and those of the residuals of all of them and of those without friction."""
    n_p = len(torques)
    u, parts = measured.ravel(), torques.reshape(n_p, -1)
    power = max(float(np.sum(np.abs(u) ** 2)), 1e-300)
    shares = tuple(float(share) for share in (parts @ u.conj()).real / power)
    left, without = (
        float(np.sum(np.abs(u - chosen.sum(axis=0)) ** 2)) / power for chosen in (parts, parts[no_friction])
    )
    return shares, left, without
