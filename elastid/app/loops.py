"""loops: margins of today's joint controllers and gains of the fitted robot, as page, table and section of a study."""

from __future__ import annotations

from functools import partial

import numpy as np

from elastid.app.run import Run
from elastid.app.use_fit import Used, use_fit
from elastid.base.arrays import FloatArray
from elastid.base.display import Display, number
from elastid.base.errors import StudyError
from elastid.experiment.specs.simulated import MAX_DELAY_SAMPLES
from elastid.fit.result import Result
from elastid.report.answer import Answer
from elastid.report.figures.use import loops_figure
from elastid.store.files import write_rows, write_text
from elastid.store.measured import read_records
from elastid.store.results import write_loops
from elastid.study.robots import yaml_text
from elastid.study.source import read_source
from elastid.use.loops.plants import PostureFamily
from elastid.use.loops.result import Asked, Loops, LoopState, Today, design_loops
from elastid.use.loops.sensitivity import LIMIT_DB, Margins, MeasuredLoops, measured_loops, refusal

NAME = "loops"
_GAINS = ("position_gain", "velocity_gain", "integral_time", "low_pass_hz")


def loops_study(run: Run, asked_hz: float | None, asked_delay: int | None, draws: int) -> None:
    """All results of the study's fit; StudyError without a current one, FitError where no gains keep the limit.

    asked_hz, asked_delay: None for those of the study.
    """
    if asked_delay is not None and asked_delay > MAX_DELAY_SAMPLES:
        raise StudyError(
            "options/invalid", f"a controller answers within {MAX_DELAY_SAMPLES} samples", f"--delay {asked_delay}"
        )
    own_hz = _own_rate(run)
    rate_hz = asked_hz or own_hz
    if rate_hz is None:
        raise StudyError("options/invalid", "the study states no rate of the controller; give --rate", run.loaded.path)

    def work(result: Result) -> Used:
        """Loops of the fitted robot, with what is written of them."""
        family = PostureFamily.of(result, [linear.configuration for linear in result.linear], rate_hz)
        measured, simulated = _measured(run, family), run.study.experiment.simulated
        own_delay = 0 if simulated is None else simulated.controller.delay_samples
        asked = Asked(own_delay if asked_delay is None else asked_delay, draws, run.study.seed or 0)
        loops = design_loops(
            run.study.name, result, family, asked, _today(run, own_hz or rate_hz), measured,
            lambda words: run.console.detail(f"{NAME}: found {words}"),
        )  # fmt: skip
        files = {
            "loops.h5": lambda path: write_loops(path, loops, run.stamps["fit"]),
            "loops.yml": lambda path: write_text(path, snippet(loops)),
            "loops.csv": lambda path: write_rows(path, gain_rows(loops)),
        }
        warnings: tuple[str, ...] = ()
        if loops.today is not None and (lost := unstable(loops.today)):
            place = _place(run, "experiment", "simulated" if simulated is not None else "recorded", "controller")
            warnings = (
                f"{place}: today's controller is unstable at {own_hz or rate_hz:g} Hz in posture {', '.join(lost)}; "
                f"take the gains of {run.folder / 'loops.yml'}",
            )
        return Used(answer(loops), files, partial(loops_figure, loops), warnings=warnings)

    use_fit(run, NAME, work)


def _own_rate(run: Run) -> float | None:
    """Rate of today's controller in Hz; None where the study does not state it."""
    study = run.study
    if study.experiment.simulated is not None and study.excitation is not None:
        return study.excitation.rate_hz
    recorded = study.experiment.recorded
    if recorded is not None and recorded.rate_hz != "unknown":
        return float(recorded.rate_hz)
    return None


def _place(run: Run, *keys: str) -> str:
    """File, line and column of a key of the study, or the nearest above it."""
    return str(read_source(run.loaded.path, str(run.loaded.path)).place(keys))


def _measured(run: Run, family: PostureFamily) -> list[MeasuredLoops]:
    """Loops of each configuration whose records hold an injected torque; a warning where they do not."""
    if "measure" not in run.stages or not run.path("measure").exists():
        return []
    measured = []
    for name, inertia in zip(family.names, family.inertia, strict=True):
        records = list(read_records(run.path("measure"), name))
        if refused := refusal(records):
            run.console.warn(
                f"{_place(run, 'experiment')}: {refused}, so that today's loops cannot be measured from it; log the "
                "torque that is added to the controller's, role r, with all motors"
            )
            return []
        measured.append(measured_loops(records, run.study.estimator, inertia))
    return measured


def _today(run: Run, rate_hz: float) -> Today | None:
    """Controller that the study states; a warning where it states none."""
    experiment = run.study.experiment
    if experiment.simulated is not None:
        return Today(rate_hz, experiment.simulated.controller)
    if experiment.recorded is not None and experiment.recorded.controller is not None:
        return Today(rate_hz, experiment.recorded.controller.spec)
    run.console.warn(
        f"{_place(run, 'experiment', 'recorded')}: today's controller is not known: the study states none "
        "(experiment.recorded.controller); gains are designed all the same"
    )
    return None


def snippet(loops: Loops) -> str:
    """The designed controller as the section of a study."""
    head = (
        f"Gains for {loops.name} by `elastid loops`, at {loops.rate_hz:g} Hz, link side, SI: the section",
        "experiment.simulated.controller of a study whose excitation.rate_hz is that rate.",
    )
    return yaml_text({"controller": loops.controller}, head)


def gain_rows(loops: Loops) -> list[list[str | float]]:
    """loops.csv: a row for each axis, link side, SI."""
    own, axes = loops.gains, np.array(loops.gains.axes, int)
    notches = [own.notches[axes == i].ravel().tolist() for i in range(len(loops.joints))]
    most = max(map(len, notches))
    parts = (f"notch {i // 3 + 1} {('freq_hz', 'width', 'depth')[i % 3]}" for i in range(most))
    columns = own.position_gain, own.velocity_gain, 1 / own.position_gain, own.low_pass_hz
    rows: list[list[str | float]] = [["joint", *_GAINS, *parts]]
    for joint, numbers, further in zip(loops.joints, np.transpose(columns).tolist(), notches, strict=True):
        rows.append([joint, *numbers, *further, *[""] * (most - len(further))])
    return rows


def answer(loops: Loops) -> Answer:
    """Both controllers in words, what limits the designed one, and all margins."""
    designed, today = loops.designed, loops.today
    worst = int(np.argmax(designed.peak_db))
    lines = [f"{designed.name}: {state_words(designed)}."]
    lines.append(f"Its gain is limited in posture {designed.postures[worst]}: {designed.limited_by[worst]}.")
    if loops.count:
        kept = 100 * float(np.mean(designed.drawn_peaks_db <= LIMIT_DB))
        lines.append(f"{kept:.3g} % of {loops.count} draws keep {LIMIT_DB:g} dB in all postures.")
    rows, bandwidth = gain_rows(loops), designed.bandwidth_hz.min(axis=0)
    gains = [
        (
            str(row[0]), *(number(float(each), 4) for each in row[1:5]),
            ", ".join(number(float(each), 3) for each in row[5::3] if each != ""), number(float(f_B), 3),
        )
        for row, f_B in zip(rows[1:], bandwidth, strict=True)
    ]  # fmt: skip
    heads = ("axis", "bandwidth in Hz", "gain margin in dB", "phase margin in deg", "delay margin in ms")
    return Answer(
        f"Joint loops of {loops.name}",
        (
            ("How fast may the loops be?", tuple(lines)),
            ("How good are today's?", (f"{state_words(today)}." if today else "The study states no controller.",)),
            ("What next?", ("Run a study with the section of loops.yml before the robot does.",)),
        ),
        (
            Display(
                "Sensitivity", ("controller", "posture", "peak in dB", "95 % of draws", "limited by"),
                [tuple(row) for row in loops.peak_cells],
            ),
            Display("What is left to the edge", ("controller", *heads), margins(loops)),
            Display("Gains", ("axis", "K_p 1/s", "K_v", "T_i s", "low pass Hz", "notches Hz", "bandwidth Hz"), gains),
        ),
        (
            f"Bands: 95 % of {loops.count} robots drawn from the fit, over all postures. Sensitivity: largest singular "
            "value, torques of the axes compared by their inertias. Dots: measured from the records, without a model. "
            "Margins: the smallest over the postures, each axis while all others are closed. Below: the section of a "
            "study, link side, SI.",
        ),
        snippet(loops),
    )  # fmt: skip


def margins(loops: Loops) -> list[tuple[str, ...]]:
    """Cells of each axis of each controller, the smallest over the postures, then as measured."""
    known: list[tuple[str, tuple[str, ...], FloatArray | None, Margins]] = [
        (state.name, state.axes, state.bandwidth_hz, state.margins) for state in loops.states
    ]
    known += [(f"measured, {own.configuration}", own.axes, None, own.margins) for own in loops.measured]
    rows = []
    for name, axes, bandwidth_hz, own in known:
        for i, axis in enumerate(axes):
            numbers = [np.nan if bandwidth_hz is None else bandwidth_hz[:, i].min()]
            numbers += [20 * np.log10(own.rise[:, i].min()), np.degrees(own.phase[:, i].min())]
            cells = (number(float(each), 3) for each in (*numbers, 1e3 * own.delay[:, i].min()))
            rows.append((name, axis, *cells))
    return rows


def unstable(state: LoopState) -> list[str]:
    """The postures in which a loop is unstable."""
    return [name for name, peak in zip(state.postures, state.peak_db, strict=True) if not np.isfinite(peak)]


def state_words(state: LoopState) -> str:
    """Stability, bandwidths, peak and margins over all postures."""
    if lost := unstable(state):
        return f"unstable in posture {', '.join(lost)}"
    least = state.bandwidth_hz.min(axis=0)
    each = ", ".join(f"{axis} {number(float(f), 3)}" for axis, f in zip(state.axes, least, strict=True))
    rise, phase = 20 * np.log10(state.margins.rise.min()), np.degrees(state.margins.phase.min())
    gain = f"{rise:.3g} dB" if np.isfinite(rise) else "infinite"
    return (
        f"bandwidth in Hz {each}; sensitivity peak {number(float(state.peak_db.max()), 3)} dB; gain margin {gain}, "
        f"phase margin {phase:.3g} deg, delay margin {1e3 * state.margins.delay.min():.3g} ms"
    )
