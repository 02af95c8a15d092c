"""Response: G (F, n_y, n_u) of one configuration, measured or modelled, with covariance and quality.

    Y(k) = G(k) U(k),   G (F, n_y, n_u)

Measurement and model both end in this value. All on the link side, outputs of one quantity (acceleration unless stated
otherwise).
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Any

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled, laplace_variable, quotient
from elastid.base.display import Display, as_html, as_text
from elastid.base.errors import Note, check_kind, index_of, require_package
from elastid.base.escape import control_labels
from elastid.base.messages import WorkerConstant
from elastid.covariance import Covariance as Covariance
from elastid.covariance import scale_covariance
from elastid.record import (
    MOTION_ORDER,
    Configuration,
    JointLoop,
    Motion,
    Motors,
    ReferenceLoop,
    ZohTorque,
    drive_unit,
    motion_unit,
)

STEP_IMAGES = "records/step-images"  # code of a note on images of a sampled reference, information if subtracted
# Of `Response.bias` by distortion: the second order, the turned part of it, and the own part of the first.
SYSTEMATIC_ERRORS = 3
UNEXPLAINED = "nonlinear/unexplained-distortion"  # code of a note on distortion that no friction of motors explains


@frozen_value
class LineAmplitudes:
    """RMS amplitudes (K, n_y) of the outputs at freq_hz (K,), in `quantity`, and of the noise (K, n_y) in them.

    amplitude: root mean square over all experiments of the mean over periods; it includes the noise.
    """

    freq_hz: FloatArray = labelled("frequency")
    amplitude: FloatArray = labelled("RMS amplitude of the outputs", "{output_unit}", "freq_hz outputs")
    noise: FloatArray = labelled("standard deviation of the noise in it", "{output_unit}", "freq_hz outputs")


@frozen_value
class Quality:
    """Signal quality of a measured FRF at its F excited lines; even and odd distortion are at their detection lines.

    coherence (F, n_y, n_u) and multiple_coherence (F, n_y), of single periods.  singular_values (F, min(n_y, n_u)) of
    G, largest first.  input_singular_values (F, n_u) of the experiments' inputs, each input relative to its RMS: their
    ratio is the condition of the input matrix.  input_noise (F, n_u) and output_noise (F, n_y): variance in one period.
    excited: the outputs.  stochastic (F, n_y): RMS amplitude of the stochastic nonlinear distortion in them, or None.
    even, odd: Y - G U at lines that were not excited, from nonlinearities of even and odd order, or None.
    """

    coherence: FloatArray = labelled("coherence of one output and one input", "", "freq_hz outputs inputs")
    multiple_coherence: FloatArray = labelled("coherence of one output and all inputs", "", "freq_hz outputs")
    singular_values: FloatArray = labelled("singular values of G, largest first", "{unit}", "freq_hz rank")
    input_singular_values: FloatArray = labelled("singular values of the inputs over their RMS", "", "freq_hz rank")
    input_noise: FloatArray = labelled("noise variance in one period", "({units_of_inputs})^2", "freq_hz inputs")
    output_noise: FloatArray = labelled("noise variance in one period", "({output_unit})^2", "freq_hz outputs")
    excited: LineAmplitudes
    stochastic: FloatArray | None = labelled("RMS distortion", "{output_unit}", "freq_hz outputs", default=None)
    even: LineAmplitudes | None = None
    odd: LineAmplitudes | None = None

    @property
    def condition(self) -> FloatArray:
        """Condition (F,) of the input matrix, each input relative to its RMS; inf where it is singular."""
        largest, smallest = self.input_singular_values[:, 0], self.input_singular_values[:, -1]
        with np.errstate(over="ignore"):
            return quotient(largest, smallest, np.inf)

    def lines(self, keep: BoolArray) -> "Quality":
        """Select lines; keep (F,) is True for a line that stays."""
        arrays: dict[str, Any] = {name: part[keep] for name, part in vars(self).items() if isinstance(part, np.ndarray)}
        return replace(self, **arrays, excited=LineAmplitudes(*(part[keep] for part in vars(self.excited).values())))


@frozen_value
class MotorMotion:
    """The motion of the motors in which a response was measured, about its configuration.

    power (K, n_m, n_m) of `motors` at freq_hz (K,): cross spectra of their angles, mean squares over all experiments,
    carriers included.  mean (n_m,): of their angles, NaN where positions were not logged.  feedback (3, n_m, n_m):
    F = F_0 / s + F_1 + F_2 s of the controller, by which torques answer angles, u = r - F q; None where the records do
    not show it.
    """

    motors: tuple[str, ...]
    freq_hz: FloatArray = labelled("frequency of the motion")
    power: ComplexArray = labelled("cross spectra of motor angles, link side", "rad^2", "freq_hz motors motors")
    mean: FloatArray = labelled("mean angle of the motors, link side", "rad", "motors")
    feedback: FloatArray | None = labelled("of integral, angle and velocity", "SI", "term motors motors", default=None)

    @property
    def rms(self) -> FloatArray:
        """RMS (n_m,) of each motor's angle, rad or m."""
        return np.asarray(np.sqrt(np.einsum("kii->i", self.power).real))

    def grouped(self, most: int) -> "MotorMotion":
        """Group neighbouring lines to at most so many, each at the frequency of the same mean square velocity."""
        if len(self.freq_hz) <= most:
            return self
        starts = np.arange(most) * len(self.freq_hz) // most
        sizes = np.maximum(np.einsum("kii->k", self.power).real, 1e-300)
        squares = np.add.reduceat(sizes * self.freq_hz**2, starts) / np.add.reduceat(sizes, starts)
        return replace(self, freq_hz=np.sqrt(squares), power=np.add.reduceat(self.power, starts))


@frozen_value
class Response(WorkerConstant):
    """Measured frequency response G of one configuration, link side.

    Parameters
    ----------
    freq_hz, has_rate : array (F,), bool
        Increasing frequencies of the lines; relative to an unknown sampling rate if False.
    G : complex array (F, n_y, n_u)
        Response of the outputs, in `quantity`, per Nm (N for sliding joints).
    inputs, outputs : tuple of str
        Locations of the columns and rows of G, such as "motor 1".
    quantity : str
        Quantity of the outputs: position, velocity or acceleration.
    configuration : Configuration
        Posture of the measurement.
    noise : Covariance or None
        Covariance of G due to noise, from the scatter of periods.
    total : Covariance or None
        Covariance of G due to noise and nonlinear distortion, from the scatter of realisations.
    quality : Quality or None
        Coherence, distortion and noise levels.
    notes, repairs : tuple of Note, mapping of str to int
        Findings of the estimation, and number of corrections of the records by kind.
    sliding, input_units : tuple of str
        Translating inputs and outputs, with units N and m; unit of each input with a voltage or a current.
    bias : complex array (n_b, n_u, F, n_y, n_u) or None
        Systematic errors by friction of each input's motor or by images of its references, each with an unknown factor
        of unit variance; all configurations share the first factors, the last one belongs to this configuration.
    image_errors : int
        Number of the first systematic errors in `bias` that are images of references instead of friction.
    correlated_lines : float
        Number of lines over which the noise of G is correlated (sum of the autocorrelation), 1 for independent lines.
    hold : ZohTorque or None
        Zero-order hold of the torques whose aliases G contains.
    leakage : complex array (F, n_y, n_u) or None
        First-order leakage error of segments; `total` includes its square.
    motion : MotorMotion or None
        Motion of the motors during the measurement.
    window, segment_s : str, float
        Window and length of the segments that smooth G over frequency, "" and 0 without segments.
    motors, loop : str, JointLoop or None
        Motors during the measurement: "free", or for forces at the tool "locked" or "controlled" by `loop`.
    controller : ReferenceLoop or None
        Controllers of the motors, if the inputs are references such as "reference 1".
    ratio_std : array (n_u,)
        Relative std of each gear ratio over the motion without a tolerance of the robot model; empty if unknown.

    Raises
    ------
    ValueError
        For inconsistent shapes, frequencies that do not increase, or values that are not finite.

    Examples
    --------
    >>> G = np.ones((2, 1, 1), complex)
    >>> posture = Configuration("bench", [0.0])
    >>> response = Response(np.array([5.0, 6.0]), G, ("motor 1",), ("motor 1",), "acceleration", posture)
    >>> response.unit
    '(rad/s^2)/(N*m)'
    """

    freq_hz: FloatArray = labelled("frequency")
    G: ComplexArray = labelled("frequency response, link side", "{unit}", "freq_hz outputs inputs")
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion
    configuration: Configuration
    noise: Covariance | None = None
    total: Covariance | None = None
    has_rate: bool = True
    notes: tuple[Note, ...] = field(default=())
    quality: Quality | None = None
    repairs: Mapping[str, int] = field(default_factory=dict)
    sliding: tuple[str, ...] = ()
    input_units: tuple[str, ...] = ()
    bias: ComplexArray | None = labelled(
        "error by friction", "{unit}", "extent inputs freq_hz outputs inputs", default=None
    )
    image_errors: int = 0
    correlated_lines: float = 1.0
    hold: ZohTorque | None = None
    leakage: ComplexArray | None = labelled(
        "error by leakage of windows, to first order", "{unit}", "freq_hz outputs inputs", default=None
    )
    motion: MotorMotion | None = None
    window: str = ""
    segment_s: float = 0.0
    motors: Motors = "free"
    loop: JointLoop | None = None
    controller: ReferenceLoop | None = None
    ratio_std: FloatArray = labelled(
        "usual std of each gear's ratio over the motion", "", "inputs", default_factory=lambda: np.zeros(0)
    )

    def __post_init__(self) -> None:
        """Check names and arrays."""
        check_kind(self.configuration, Configuration, "configuration", "Configuration(name, angles) makes one")
        index_of(self.quantity, tuple(MOTION_ORDER), "quantity")
        shape = (len(self.freq_hz), len(self.outputs), len(self.inputs))
        where = f"response of {self.configuration.name}"
        if self.G.shape != shape:
            raise ValueError(f"{where}: G has shape {self.G.shape}, expected (F, n_y, n_u) = {shape}")
        if np.any(np.diff(self.freq_hz) <= 0):
            raise ValueError(f"{where}: the frequencies do not increase")
        bad = np.flatnonzero(~np.isfinite(self.G).all(axis=(1, 2)))
        if bad.size:
            raise ValueError(f"{where}: G is not finite at {bad.size} lines, first {self.freq_hz[bad[0]]:g} Hz")
        for name in ("noise", "total"):
            covariance = getattr(self, name)
            if covariance is not None and covariance.variance.shape != shape:
                raise ValueError(f"{where}: {name} variance has shape {covariance.variance.shape}, expected {shape}")
        if self.bias is not None and self.bias.shape[1:] != (len(self.inputs), *shape):
            raise ValueError(f"{where}: bias has shape {self.bias.shape}, expected (n_b, n_u, F, n_y, n_u)")

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Lines, quantity and configuration, and each element with its range and its relative standard deviation."""
        unit = "Hz" if self.has_rate else "times the sampling rate"
        band = f"{self.freq_hz[0]:.4g} to {self.freq_hz[-1]:.4g} {unit}" if self.n_lines else "none"
        magnitude = np.abs(self.G)
        rows = [
            (y, u, f"{magnitude[:, i, j].min():.3g} to {magnitude[:, i, j].max():.3g}", self._relative_std(i, j))
            for i, y in enumerate(self.outputs)
            for j, u in enumerate(self.inputs)
            if self.n_lines
        ]
        size = f"{len(self.outputs)} x {len(self.inputs)} at {self.n_lines} lines, {band}"
        remark = "" if self.uncertainty is not None else "; its noise is unknown: no covariance was estimated or given"
        title = f"Response of {self.configuration.name}: {self.quantity} in {self.unit}, {size}{remark}"
        return Display(title, ("output", "input", "|G|", "relative std, median"), rows)

    def _relative_std(self, i: int, j: int) -> str:
        if self.uncertainty is None:
            return "unknown"
        magnitude = np.maximum(np.abs(self.G[:, i, j]), 1e-300)
        return f"{100 * float(np.median(np.sqrt(self.uncertainty.variance[:, i, j]) / magnitude)):.2g} %"

    @property
    def n_lines(self) -> int:
        """F, the number of lines."""
        return len(self.freq_hz)

    @property
    def unit(self) -> str:
        """Unit of G; several where some places rotate and others slide."""
        return f"({self.output_unit})/({' or '.join(dict.fromkeys(self.units_of_inputs))})"

    @property
    def units_of_inputs(self) -> tuple[str, ...]:
        """The unit of each input."""
        return self.input_units or tuple(drive_unit(location in self.sliding) for location in self.inputs)

    @property
    def output_unit(self) -> str:
        """Unit of the outputs; several where some rotate and others slide."""
        return " or ".join(dict.fromkeys(motion_unit(self.quantity, place in self.sliding) for place in self.outputs))

    @property
    def uncertainty(self) -> Covariance | None:
        """The covariance that gives the weights of a fit: total where realisations gave one, else noise."""
        return self.total if self.total is not None else self.noise

    def lines(self, keep: BoolArray) -> "Response":
        """Select lines; keep (F,) is True for a line that stays. ValueError for another size."""
        if np.shape(keep) != (self.n_lines,):
            raise ValueError(f"keep has shape {np.shape(keep)}; the response has {self.n_lines} lines")

        given = {name: value for name, value in vars(self).items() if value is not None}
        arrays = {name: given[name][keep] for name in ("freq_hz", "G", "leakage") if name in given}
        selected = {name: given[name].lines(keep) for name in ("noise", "total", "quality") if name in given}
        return replace(self, **arrays, **selected, bias=None if self.bias is None else self.bias[:, :, keep])

    def __getitem__(self, locations: tuple[str | Sequence[str], str | Sequence[str]]) -> "Response":
        """The response of some outputs to some inputs: response["motor 1", "motor 2"], outputs first, with covariance.

        Each a place or a sequence of places.  Quality and errors by friction belong to all of them and are left out.
        UnknownNameError for a place that is none.
        """
        check_kind(locations, tuple, "places", 'give outputs and inputs, response["joint 1", "motor 1"]')
        outputs, inputs = ((location,) if isinstance(location, str) else tuple(location) for location in locations)
        rows = [index_of(location, self.outputs, "output") for location in outputs]
        columns = [index_of(location, self.inputs, "input") for location in inputs]

        uncertainties = {"noise": self.noise, "total": self.total}
        selected: dict[str, Any] = {n: c.elements(rows, columns) for n, c in uncertainties.items() if c is not None}
        return replace(
            self, **selected, G=self.G[:, rows][:, :, columns], inputs=inputs, outputs=outputs,
            input_units=tuple(self.input_units[j] for j in columns) if self.input_units else (),
            leakage=None if self.leakage is None else self.leakage[:, rows][:, :, columns], quality=None, bias=None,
            image_errors=0, ratio_std=self.ratio_std[columns] if len(self.ratio_std) else self.ratio_std,
        )  # fmt: skip

    @property
    def std(self) -> FloatArray:
        """Standard deviation (F, n_y, n_u) of the complex number G, E|dG|^2 ^ 1/2; ValueError where it is not known."""
        if self.uncertainty is None:
            raise ValueError(
                f"response of {self.configuration.name}: its noise is unknown, no covariance was estimated"
            )
        return np.sqrt(self.uncertainty.variance)

    @property
    def coherence(self) -> FloatArray:
        """Multiple coherence (F, n_y) of each output with all inputs; ValueError where it was not measured."""
        if self.quality is None:
            raise ValueError(
                f"response of {self.configuration.name}: it has no coherence, which comes with an estimate from records"
            )
        return self.quality.multiple_coherence

    def to_control(self) -> Any:
        """Convert to `control.FrequencyResponseData` over rad/s, which has no covariance."""
        import control  # takes a second or two

        labels = control_labels(self.configuration.name, self.inputs, self.outputs)
        return control.frd(np.moveaxis(self.G, 0, 2), 2 * np.pi * self.freq_hz, **labels)

    @classmethod
    def from_control(cls, data: Any, configuration: Configuration, quantity: Motion = "acceleration") -> "Response":
        """Convert `control.FrequencyResponseData`, whose labels name the locations, to a response with unknown noise.

        Link side and SI, as every response.  A system becomes such data by `control.frd(system, omega)`; TypeError
        for the system itself.
        """
        from control import FrequencyResponseData  # takes a second or two

        check_kind(data, FrequencyResponseData, "data", "control.frd(system, omega) makes one, omega in rad/s")
        omega, G = np.asarray(data.omega), np.moveaxis(np.asarray(data.frdata), 2, 0)
        return cls(omega / (2 * np.pi), G, tuple(data.input_labels), tuple(data.output_labels), quantity, configuration)

    def to_xarray(self) -> Any:
        """Convert to an `xarray.Dataset`: G and its known standard deviations over freq_hz, output and input.

        ElastidError where xarray is not installed.
        """
        axes = ("freq_hz", "output", "input")
        stds = {"noise_std": self.noise, "total_std": self.total}
        stds_of = {name: np.sqrt(covariance.variance) for name, covariance in stds.items() if covariance is not None}
        return require_package("xarray", "notebook").Dataset(
            {name: (axes, values) for name, values in {"G": self.G, **stds_of}.items()},
            {"freq_hz": self.freq_hz, "output": list(self.outputs), "input": list(self.inputs)},
            {"unit": self.unit, "quantity": self.quantity, "configuration": self.configuration.name},
        )


class Responses(tuple[Response, ...]):
    """Responses in their order, by number or by the name of a configuration: responses[0], responses["folded"]."""

    __slots__ = ()

    @property
    def names(self) -> list[str]:
        """The name of each configuration."""
        return [response.configuration.name for response in self]

    def __getitem__(self, where: Any) -> Any:
        """The response of a configuration, or as of any tuple; UnknownNameError for a name that none has."""
        if isinstance(where, str):
            where = index_of(where, self.names, "configuration")
        return super().__getitem__(where)


def in_quantity(response: Response, quantity: Motion) -> Response:
    r"""Convert the response and its covariance to position, velocity or acceleration per torque.

    .. math:: G' = (j\omega)^k G, \qquad cov(vec\, G') = \omega^{2k} cov(vec\, G)
    """
    k = index_of(quantity, tuple(MOTION_ORDER), "quantity") - MOTION_ORDER[response.quantity]
    if k == 0:
        return response
    gain = (laplace_variable(response.freq_hz) ** k)[:, None, None]
    power = np.abs(gain) ** 2
    return replace(
        response,
        G=gain * response.G,
        quantity=quantity,
        noise=scale_covariance(response.noise, power),
        total=scale_covariance(response.total, power),
        quality=None,  # it belongs to the outputs as they were measured
        bias=None if response.bias is None else gain * response.bias,
        leakage=None if response.leakage is None else gain * response.leakage,
    )
