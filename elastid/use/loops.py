"""Joint control loops of a study: current and designed controller on the identified robot, peaks and bandwidths.

Each peak within 0.5 dB of the largest is assigned to the axis with the largest contribution, and to the nearest mode of
the robot with free motors that moves the motor of this axis. If every mode is more than a third away, the cause is the
phase of the loop: the gains at low frequencies; delay, sampling and filters at high frequencies.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.record import JointLoop
from elastid.simulation.controller import Filters, filters_of, gains_of
from elastid.simulation.spec import ControllerSpec
from elastid.use.cascade import Cascade
from elastid.use.closed_loops import Closed, Scene
from elastid.use.gain_design import design_robust
from elastid.use.plants import PlantMode, Plants, PostureFamily

# Largest relative distance of a mode from the peak that it causes, and least participation of the motor in this mode.
_MAX_DISTANCE, _MIN_PARTICIPATION = 1 / 3, 5e-3


@frozen_value
class LoopState:
    """Assessment of a controller in Q postures of n_u axes, with 95 % intervals by D posterior samples (else NaN).

    peak_db (Q,): M_S, infinite for an unstable loop.  drawn_peaks_db (D,).  freq_hz, sensitivity_db (Q, K).
    """

    name: str
    postures: tuple[str, ...]
    axes: tuple[str, ...]
    peak_db: FloatArray = labelled("sensitivity peak", "dB", "postures")
    peak_low: FloatArray = labelled("lower end of 95 % of draws", "dB", "postures")
    peak_high: FloatArray = labelled("upper end of 95 % of draws", "dB", "postures")
    limited_by: tuple[str, ...] = labelled("cause of the peak", axes="postures")
    bandwidth_hz: FloatArray = labelled("bandwidth of each axis", "Hz", "postures axes")
    drawn_peaks_db: FloatArray = labelled("sensitivity peak of each draw over all postures", "dB", "draw")
    freq_hz: FloatArray = labelled("frequency", "Hz", "postures line")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "postures line")


def assess(
    name: str, family: PostureFamily, drawn: Plants | None, gains: JointLoop, filters: Filters | None
) -> LoopState:
    """Assess a controller with gains (n_u,) or (Q, n_u) in the Q postures of a family; drawn: D Q plants, or None."""
    plants, axes = family.estimate, family.axes
    loops = Closed(Scene.of(plants, 600, 41), gains, filters)
    causes = tuple("; ".join(_causes(loops, q, modes, axes)) for q, modes in enumerate(family.modes))
    peaks, bandwidth = loops.peaks_db, loops.bandwidth_hz
    ends, drawn_peaks = np.full((2, *peaks.shape), np.nan), np.zeros(0)
    if drawn is not None:
        D = len(drawn) // len(plants)
        tiled = gains.gain_derivatives(lambda gain: np.tile(np.broadcast_to(gain, bandwidth.shape), (D, 1)))
        of_draws = Closed(Scene.of(drawn, 120, 9), tiled, filters).peaks_db.reshape(D, -1)
        # Order statistics, because quantiles of infinities would be NaN.
        ends = np.sort(of_draws, axis=0)[[int(0.025 * (D - 1)), int(np.ceil(0.975 * (D - 1)))]]
        drawn_peaks = of_draws.max(axis=1)
    size_db, postures = 20 * np.log10(loops.size), tuple(posture.name for posture in family.configurations)
    return LoopState(
        name, postures, axes, peaks, ends[0], ends[1], causes, bandwidth, drawn_peaks, loops.scene.freq_hz, size_db
    )


def _causes(loops: Closed, q: int, modes: tuple[PlantMode, ...], axes: tuple[str, ...]) -> Iterator[str]:
    """Yield the cause of each peak of posture q that limits the gains."""
    size, root = np.pad(loops.size[q], 1, constant_values=0.0), np.sqrt(loops.scene.plants.inertia[q])
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:]))
    # A peak within 0.5 dB of the largest one limits the gains as well.
    binding = peaks[loops.size[q, peaks] >= loops.size[q].max() * 10 ** (-0.5 / 20)]
    for line in binding if loops.stable[q] else [int(loops.size[q].argmax())]:
        freq_hz = float(loops.scene.freq_hz[q, line])
        U, _, Vh = np.linalg.svd(loops.S[q, line] / root[:, None] * root)
        i = int(np.abs(U[:, 0] * Vh[0]).argmax())
        candidates = [mode for mode in modes if mode.motor_amplitudes[i] >= _MIN_PARTICIPATION]
        nearest = min(candidates, key=lambda mode: abs(np.log(mode.freq_hz / freq_hz)), default=None)
        if not loops.stable[q]:
            yield f"unstable, at {freq_hz:.3g} Hz in axis {axes[i]}"
        elif nearest is not None and abs(nearest.freq_hz / freq_hz - 1) <= _MAX_DISTANCE:
            yield f"axis {axes[i]} at {freq_hz:.3g} Hz: mode at {nearest.freq_hz:.3g} Hz, {nearest.spring}"
        else:
            is_slow = nearest is not None and freq_hz < nearest.freq_hz
            cause = "gains and notches below its modes" if is_slow else "delay and filters above its modes"
            yield f"axis {axes[i]} at {freq_hz:.3g} Hz: {cause}"


TODAY, DESIGNED = "today's controller", "designed controller"


@frozen_value
class Loops:
    """Assessment of the study's controller (None if not given) and of the designed one; count: posterior samples."""

    name: str
    joints: tuple[str, ...]
    rate_hz: float = labelled("rate of the controller", "Hz")
    count: int
    today: LoopState | None
    designed: LoopState
    gains: Cascade

    @property
    def controller(self) -> ControllerSpec:
        """Designed controller, as a section of a study."""
        return self.gains.to_spec(self.joints)

    @property
    def states(self) -> tuple[LoopState, ...]:
        """Present controller, if known, and designed controller."""
        return tuple(state for state in (self.today, self.designed) if state is not None)


def todays_loops(family: PostureFamily, drawn: Plants | None, spec: ControllerSpec) -> LoopState:
    """Assess a controller in all postures; gains that follow from a bandwidth differ between postures."""
    model, theta = family.family.model, family.family.theta
    first, *rest = (gains_of(model, equilibrium(model, theta, posture).q, spec) for posture in family.configurations)
    gains = first.gain_derivatives(lambda *of_postures: np.array(of_postures), *rest)
    return assess(TODAY, family, drawn, gains, filters_of(family.axes, spec, family.rate_hz))


def design_loops(
    name: str, result: Result, family: PostureFamily, delay_samples: int, draws: int, seed: int,
    today: ControllerSpec | None = None, today_hz: float | None = None,
) -> Loops:  # fmt: skip
    """Design loops at the rate of a family of the fit; FitError if no gains keep the limit in all its postures.

    delay_samples: of the designed loops.  draws: number of posterior samples.  today: the study's controller; today_hz:
    its rate, default the family's.
    """

    def drawn_of(family: PostureFamily) -> Plants | None:
        return family.draws(result, draws, seed) if draws else None

    state, drawn = None, drawn_of(family)
    if today is not None:
        variant = replace(family, rate_hz=today_hz) if today_hz else family
        is_same = variant.rate_hz == family.rate_hz
        state = todays_loops(family, drawn, today) if is_same else todays_loops(variant, drawn_of(variant), today)
    first_hz = min((mode.freq_hz for modes in family.modes for mode in modes), default=family.rate_hz)
    cascade = design_robust(family.estimate, drawn, first_hz, delay_samples)
    designed = assess(DESIGNED, family, drawn, cascade.gains, cascade.filters(family.rate_hz))
    return Loops(name, family.axes, family.rate_hz, draws, state, designed, cascade)
