"""Record: sampled signals of an experiment, with rate, places, configuration and controller.

A signal is named by where it acts, the same text in a study, a record, a response and a model:
`motor 1` (torque or angle of the motor that drives joint 1, referred to the link), `joint 1` (relative angle of a
joint), `body arm z` and `frame tool rz` (absolute rotation of a body or frame about one of its own axes),
`frame tool z` (motion of a frame's origin along its axis), `accelerometer tool z` (the same less gravity along it).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import field, replace
from itertools import starmap
from typing import Any, Literal, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import Note
from elastid.base.units import translation_unit

Hold: TypeAlias = Literal["band-limited", "zero-order"]
Motion: TypeAlias = Literal["position", "velocity", "acceleration"]
Motors: TypeAlias = Literal["locked", "free", "controlled"]
MOTION_UNIT: dict[str, str] = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2"}
MOTION_ORDER: dict[str, int] = {quantity: order for order, quantity in enumerate(MOTION_UNIT)}


def motion_unit(quantity: Motion, slides: bool) -> str:
    """Return the SI unit of a motion.

    >>> motion_unit("acceleration", True)
    'm/s^2'
    """
    return translation_unit(MOTION_UNIT[quantity]) if slides else MOTION_UNIT[quantity]


def drive_unit(slides: bool) -> str:
    """Return the SI unit of the drive of a motion: a force where it translates, else a torque."""
    return translation_unit("N*m") if slides else "N*m"


@frozen_value
class ZohTorque:
    """Torques held between their samples, and the outputs in which images of them are.

    rates_hz (n_u,): at which each torque is renewed, 0 where it is not held.  sampled (n_y,): whether an output is an
    angle (or a position) sampled at these instants without a filter before it, as an encoder is.
    """

    rates_hz: tuple[float, ...]
    sampled: tuple[bool, ...]


def unit_delay(freq_hz: FloatArray, rate_hz: float) -> ComplexArray:
    """Return 1 / z (...) of samples at rate_hz on the unit circle at freq_hz (...)."""
    return np.asarray(np.exp(-2j * np.pi * freq_hz / rate_hz))


@frozen_value
class JointLoop:
    """Feedback u = -(kp + kd s) (1 + ki / s) y of each motor; kp, kd, ki (n_u,), link side, SI.

    ki: 0 without integral action.
    """

    kp: FloatArray
    kd: FloatArray
    ki: FloatArray = field(default_factory=lambda: np.zeros(1))

    def gain_derivatives(self, change: Callable[..., Any], *others: "JointLoop") -> "JointLoop":
        """Return derivatives of a joint loop with respect to kp, kd and ki, combined with the other loops."""
        gains = zip(*((loop.kp, loop.kd, loop.ki) for loop in (self, *others)), strict=True)
        return JointLoop(*starmap(change, gains))

    def response(self, delay: ComplexArray, rate_hz: float) -> ComplexArray:
        """Return F (..., n_u), torque over angle of the sampled loop, at the frequencies of a `unit_delay` (...)."""
        step = 1 - delay[..., None]
        return np.asarray((self.kp + self.kd * rate_hz * step) * (1 + self.ki / rate_hz * (1 - step) / step))


MOST_IMAGES = 8  # on either side: motors hardly follow beyond
REFERENCE = "reference "  # first word of an input that is a commanded position, as in `reference 1` of `motor 1`


@frozen_value
class ReferenceLoop:
    """Sampled controllers of motors that follow references: u = C_ff r - C_fb q_m, held at rate_hz, link side.

    motors (n_m): of all loops.  feedback, feedforward (2, F, n_m): shares of k_p and of k_d in C_fb and C_ff, at
    freq_hz (F,).  log_hz: rate of references and of a log that folds the images of their steps; 0 without images.
    """

    motors: tuple[str, ...]
    rate_hz: float
    freq_hz: FloatArray = labelled("frequency")
    feedback: ComplexArray = labelled("torque over angle, of k_p and of k_d", "N*m/rad", "gain freq_hz motors")
    feedforward: ComplexArray = labelled("torque over reference, of k_p and of k_d", "N*m/rad", "gain freq_hz motors")
    log_hz: float = 0.0

    def images_hz(self, freq_hz: FloatArray) -> FloatArray:
        """Return frequencies (F, M) of either sign that a log at log_hz folds onto lines, NaN beyond half the rate."""
        images = freq_hz[:, None] + self.log_hz * np.array([*range(-MOST_IMAGES, 0), *range(1, MOST_IMAGES + 1)])
        return np.where(np.abs(images) < self.rate_hz / 2, images, np.nan)

    def at(self, freq_hz: FloatArray) -> "ReferenceLoop":
        """Return the loop at other frequencies (F',), interpolated."""
        if np.array_equal(freq_hz, self.freq_hz):
            return self
        feedback, feedforward = (
            np.apply_along_axis(lambda gains: np.interp(freq_hz, self.freq_hz, gains), 1, C)
            for C in (self.feedback, self.feedforward)
        )
        return replace(self, freq_hz=freq_hz, feedback=feedback, feedforward=feedforward)


@frozen_value
class Configuration:
    """Posture of the robot, or state of a structure without joints.

    Parameters
    ----------
    name : str
        Name of the configuration.
    angles : array (n_a,)
        Positions of the driven joints in the robot's order, rad (m for sliding joints); empty for a structure.
    has_payload : bool
        False for a measurement without the payload of the robot model.

    Raises
    ------
    ValueError
        For angles that are not finite.

    Examples
    --------
    >>> Configuration("folded", [0.0, 1.2]).angles.shape
    (2,)
    """

    name: str
    angles: FloatArray = labelled("angle of the driven joints", "rad")
    has_payload: bool = True

    def __post_init__(self) -> None:
        """Take a single angle for one joint; refuse angles that are not finite."""
        object.__setattr__(self, "angles", frozen(np.atleast_1d(self.angles)))
        if not np.all(np.isfinite(self.angles)):
            raise ValueError(f"configuration {self.name}: the angles {self.angles.tolist()} are not all finite")

    def with_angle(self, index: int, angle: float) -> "Configuration":
        """Return posture with one joint elsewhere."""
        angles = self.angles.copy()
        angles[index] = angle
        return replace(self, angles=angles)


def zero_order_hold(phase: FloatArray) -> ComplexArray:
    r"""Compute H of a zero-order hold of T at phases f T: :math:`e^{-j \pi f T} \sin(\pi f T) / (\pi f T)`."""
    return np.asarray(np.exp(-1j * np.pi * phase) * np.sinc(phase), dtype=np.complex128)


@frozen_value
class Record:
    """Measured signals of one experiment, on the link side.

    Parameters
    ----------
    name : str
        Name of the record.
    configuration : Configuration
        Posture of the measurement.
    realisation, experiment : int
        Number of the phase realisation, and of the experiment in it.
    rate_hz, has_rate : float, bool
        Sampling rate; 1 and False if it is unknown, so that frequencies are relative to it.
    period_samples : int
        Samples per period; the length of the record without a period.
    inputs, outputs : tuple of str
        Locations of u and y, such as "motor 1".
    quantities : tuple of str
        Quantity of each output: position, velocity or acceleration.
    u : array (n_samples, n_u)
        Acting torque, Nm (N for sliding joints).
    y : array (n_samples, n_y)
        Outputs in SI. Large signals are `base.large_arrays.LargeArray`: x[a:b] reads these samples.
    r : array (n_samples, n_u) or None
        Injected torque, or the commanded positions of the motors, rad.
    r_is_reference : bool
        True for commanded positions, which only serve as instruments of the estimator `joint`.
    hold : str
        Behaviour of u between samples: "band-limited", or "zero-order" for commands.
    half_wave : bool
        True for odd lines only: the second half of a period is the negated first, and each half is a repetition.
    notes, repairs : tuple of Note, mapping of str to int
        Findings about the log, and its number of corrections by kind.
    discarded_periods, starts : tuple of int
        Repetitions, from 0, that are mostly interpolated and discarded, and at which further logs start.
    sliding, input_units : tuple of str
        Translating inputs and outputs, with units N and m; unit of each input with a voltage or a current.
    is_periodic : bool
        False for a record without a period, such as noise or a sweep from rest.
    hold_samples : tuple of float
        Samples for which each input is held, 0 if band-limited. Default: as `hold`.
    sampled : tuple of bool
        Outputs that contain aliases of held torques. Default: positions.

    Raises
    ------
    ValueError
        For inconsistent shapes, or a record without a whole period.

    Examples
    --------
    >>> u, y = np.ones((8, 1)), np.zeros((8, 1))
    >>> posture = Configuration("bench", [0.0])
    >>> record = Record("a", posture, 0, 0, 100.0, 4, ("motor 1",), ("motor 1",), ("position",), u, y)
    >>> record.n_periods
    2
    """

    name: str
    configuration: Configuration
    realisation: int
    experiment: int
    rate_hz: float
    period_samples: int
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantities: tuple[Motion, ...] = labelled("quantity of each output", axes="outputs")
    u: FloatArray = labelled("torque that acts, link side", "{units_of_inputs}", "time_s inputs")
    y: FloatArray = labelled("motion, link side", "{output_units}", "time_s outputs")
    r: FloatArray | None = labelled("injected torque or reference, link side", "SI", "time_s inputs", default=None)
    r_is_reference: bool = False
    has_rate: bool = True
    notes: tuple[Note, ...] = field(default=())
    hold: Hold = "band-limited"
    half_wave: bool = False
    repairs: Mapping[str, int] = field(default_factory=dict)
    discarded_periods: tuple[int, ...] = labelled("repetitions that do not count", default=())
    sliding: tuple[str, ...] = ()
    is_periodic: bool = True
    hold_samples: tuple[float, ...] = labelled("samples for which the torque is held", axes="inputs", default=())
    starts: tuple[int, ...] = labelled("repetitions with which a further log starts", default=())
    input_units: tuple[str, ...] = ()
    sampled: tuple[bool, ...] = labelled("outputs with images of held torques", axes="outputs", default=())

    def __post_init__(self) -> None:
        """Check shapes, names and length."""
        n = self.u.shape[0]
        expected = {"u": (n, len(self.inputs)), "y": (n, len(self.outputs)), "r": (n, len(self.inputs))}
        for name, shape in expected.items():
            array = getattr(self, name)
            if array is not None and array.shape != shape:
                raise ValueError(f"record {self.name}: {name} has shape {array.shape}, expected {shape}")
        for side, name in (("outputs", "quantities"), ("inputs", "hold_samples"), ("outputs", "sampled")):
            count, values = len(getattr(self, side)), getattr(self, name)
            if len(values) != count and (values or name == "quantities"):
                raise ValueError(f"record {self.name}: {count} {side} but {len(values)} {name}")
        if not self.rate_hz > 0 or self.period_samples < 2:
            raise ValueError(f"record {self.name}: rate {self.rate_hz:g} Hz, period {self.period_samples} samples")
        if not self.is_periodic and (self.period_samples != n or self.half_wave):
            raise ValueError(
                f"record {self.name}: it has no period, so that period_samples must be its length, {n} samples, and "
                "half_wave False"
            )
        if self.half_wave and self.period_samples % 2:
            raise ValueError(f"record {self.name}: half_wave needs an even period, not {self.period_samples} samples")
        if n < self.period_samples:
            raise ValueError(
                f"record {self.name}: {n} samples are {n / self.period_samples:.2f} periods of {self.period_samples}; "
                "at least one is needed"
            )

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Length, rate and periods, and each signal with its unit."""
        length = f"{self.n_periods} periods of {self.period_samples}" if self.is_periodic else "no period"
        rate = f"{self.n_samples / self.rate_hz:.4g} s at {self.rate_hz:g} Hz" if self.has_rate else "rate unknown"
        rows = [("input", place, "drive", unit) for place, unit in zip(self.inputs, self.units_of_inputs, strict=True)]
        outputs = zip(self.outputs, self.quantities, self.output_units, strict=True)
        rows += [("output", place, quantity, unit) for place, quantity, unit in outputs]
        return Display(
            f"Record {self.name} in {self.configuration.name}: {self.n_samples} samples, {rate}, {length}",
            ("signal", "at", "quantity", "unit"),
            rows,
        )

    @property
    def output_units(self) -> tuple[str, ...]:
        """The unit of each output."""
        pairs = zip(self.quantities, self.outputs, strict=True)
        return tuple(motion_unit(quantity, location in self.sliding) for quantity, location in pairs)

    @property
    def units_of_inputs(self) -> tuple[str, ...]:
        """The unit of each input."""
        return self.input_units or tuple(drive_unit(location in self.sliding) for location in self.inputs)

    @property
    def time_s(self) -> FloatArray:
        """The times (n_samples,) of the samples, from 0 on."""
        return np.arange(self.n_samples) / self.rate_hz

    @property
    def n_samples(self) -> int:
        """Samples of each signal."""
        return int(self.u.shape[0])

    @property
    def repeat_samples(self) -> int:
        """Samples after which the signals repeat: a period, or half of one (then with opposite sign)."""
        return self.period_samples // 2 if self.half_wave else self.period_samples

    @property
    def n_repeats(self) -> int:
        """Whole repetitions in the record: periods, or half periods."""
        return self.n_samples // self.repeat_samples

    @property
    def n_periods(self) -> int:
        """Whole periods in the record; 1 where it has no period."""
        return self.n_samples // self.period_samples

    def part(self, samples: slice, **changes: Any) -> "Record":
        """Return the record of some of its samples, with changes of other fields."""
        r = None if self.r is None else self.r[samples]
        return replace(self, u=self.u[samples], y=self.y[samples], r=r, **changes)

    def hold_response(self, freq_hz: FloatArray) -> ComplexArray:
        r"""Compute H (F, n_u), with H_j(f) times the DFT of u_j the spectrum of the torque that acts: Y = G H U.

        .. math:: H = e^{-j \pi f T} \frac{\sin \pi f T}{\pi f T}, \quad T = 1 / rate\_hz \quad (zero-order)

        1 for a band-limited torque, T = hold_samples / rate_hz where these are given. The hold delays by half a sample
        and costs 1.6 % of amplitude at a tenth of the rate; a response estimated without it has a delay and a wrong
        inertia instead. An encoder, sampled without a filter, adds images of the held torque (`images`).
        """
        return zero_order_hold(np.outer(freq_hz, self.hold_lengths) / self.rate_hz)

    @property
    def images(self) -> ZohTorque | None:
        """The torques whose images are in sampled motions: those held from sample to sample of this very record.

        None where none is held.  Nothing is known of images, and none are assumed, in a log at another rate than that
        of the commands, which was filtered before it was thinned out, and in a velocity or an acceleration, which has
        passed the filter of a drive or an amplifier; a misfit by them names them.
        """
        rates = tuple(self.rate_hz if math.isclose(n, 1.0, rel_tol=1e-5) else 0.0 for n in self.hold_lengths)
        sampled = self.sampled or tuple(quantity == "position" for quantity in self.quantities)
        return ZohTorque(rates, sampled) if any(rates) else None

    @property
    def hold_lengths(self) -> tuple[float, ...]:
        """Samples for which each input is held, 0 where it is band-limited."""
        return self.hold_samples or (1.0 if self.hold == "zero-order" else 0.0,) * len(self.inputs)
