"""A folder of lab logs as a rig: their channels as records in SI, on the link side, checked before use.

A large log is measured in pieces of whole periods (without one, of any length), kept in files, each repaired and
checked as a log of its own.  Where they are not in step (a clock that differs, a piece that is refused) the log must be
measured as a whole.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import numpy as np

from elastid.base import large_arrays
from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, Note
from elastid.base.large_arrays import LargeArray
from elastid.experiment.plan.plan import Experiment
from elastid.experiment.plan.planned_run import mean_period
from elastid.experiment.specs.channels import ChannelSpec, Places, input_units
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.logs.channels import GatheredChannels, gather_channels, report_unused_references
from elastid.logs.files.formats import naming_file, size_in_pieces
from elastid.logs.repair import LogReport
from elastid.logs.repair.clock_drift import MIN_DELAY_CORRELATION, estimate_delay
from elastid.logs.repair.masks import STOPPED
from elastid.logs.repair.missing import repair, repair_without_period
from elastid.logs.repair.periodicity import check_repeat, grid_samples, report_unstated_period
from elastid.logs.repair.resampling import RESAMPLED
from elastid.logs.repair.time_stamps import SET_BACK
from elastid.logs.repeated_logs import MAX_LAG, join_periods
from elastid.logs.step_images import without_step_images
from elastid.logs.units_and_sides import UNWRAPPED, hold_samples, on_one_side, report_drives, to_joints
from elastid.record import REFERENCE, Motion, Record, motion_unit
from elastid.robot import before_channels


@dataclass(frozen=True)
class _Pieces:
    """Pieces of n samples of a log from `start` on, each from a first to before a last one of them; its precision."""

    start: int
    n: int
    bounds: tuple[tuple[int, int], ...]
    dtype: np.dtype[Any]


@dataclass(frozen=True)
class RecordedRig:
    """Rig of recorded logs that `study.checks` has compared with robot and files. base: folder of the study.

    `measure`: DataError for a log that is of no use.
    """

    robot: Places
    spec: ExperimentSpec
    base: Path

    @property
    def _recorded(self) -> RecordedSpec:
        return self.spec.as_recorded()

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """One for each file, in their order; files of the same numbers hold further periods of its excitation."""
        postures = self.spec.postures
        runs = {file.run: postures[file.configuration] for file in self._recorded.files}
        return tuple(Experiment(replace(posture, name=name), *numbers) for (name, *numbers), posture in runs.items())

    def measure(self, experiment: Experiment) -> Record:
        """Read one experiment from its logs: channels in SI on the link side, repaired, in whole periods."""
        files, records = self._files(experiment), []
        for file in files:
            path = self.base / file.path
            with naming_file(path, f"its values cannot be used as a log. Check them with `elastid inspect {path}`"):
                record = self._in_pieces(experiment, file) if len(files) == 1 else None
                records.append(record or self._whole_record(experiment, file, len(files) > 1))
        return records[0] if len(records) == 1 else join_periods(records, [file.path for file in files])

    def is_large(self, experiment: Experiment) -> bool:
        """Return True if the log of an experiment is read in pieces, with the required channels remaining in it."""
        files = self._files(experiment)
        return len(files) == 1 and self._pieces(files[0]) is not None

    def _files(self, experiment: Experiment) -> list[FileSpec]:
        run = (experiment.configuration.name, experiment.realisation, experiment.experiment)
        return [file for file in self._recorded.files if file.run == run]

    def _pieces(self, file: FileSpec) -> _Pieces | None:
        """Return pieces of a log; None if it is read as a whole."""
        recorded, path, period = self._recorded, self.base / file.path, self._recorded.period_of(file)
        is_mixed = any(c.rate_hz is not None or c.role == "d" or c.errors for c in recorded.channels)
        needs_all = period == "find" or (period or 0) % 1 or recorded.time or file.also or is_mixed
        # Unless compressed, a value takes a byte of the file at least.
        if needs_all or path.stat().st_size < MIN_VALUES:
            return None
        n, dtype = size_in_pieces(path, recorded.channels, recorded.text)
        start, end = file.samples or (0, n)
        if not 0 <= start < end <= n:
            return None
        bounds = piece_bounds(end - start, None if period is None else int(period), len(recorded.channels))
        return _Pieces(start, end - start, bounds, dtype) if bounds else None

    def _in_pieces(self, experiment: Experiment, file: FileSpec) -> Record | None:
        """Read the record of a log that exceeds the memory; None if it fits, or must be read as a whole."""
        log = self._pieces(file)
        if log is None:
            return None

        def measured(first: int, last: int) -> Record:
            return self._whole_record(experiment, replace(file, samples=(log.start + first, log.start + last)))

        try:
            record = join_pieces(measured, log.bounds, log.dtype)
        except DataError:  # the whole record decides if this piece is an error
            record = None
        if record is None:
            return None
        end = LogReport("", ())
        report_cut(log.n - record.n_samples, log.n, record.repeat_samples, end)
        return replace(record, notes=(*record.notes, *end.findings.at(f"record {record.name}")))

    def _whole_record(self, experiment: Experiment, file: FileSpec, has_others: bool = False) -> Record:
        recorded = self._recorded
        gathered = gather_channels(recorded, file, self.base, self.robot)
        channels, location = gathered.channels, f"record {experiment.name}"
        location += f", {file.path}" if has_others else ""
        roles, locations = _columns_of_roles(channels), [channel.at for channel in channels]
        signals, N, rate_hz = repair_signals(gathered, recorded, has_others)
        log, repairs = gathered.log, gathered.log.findings.repairs
        report_unused_references(channels, log, roles["r"] or roles["u"])
        report_drives(channels, signals, N, log)
        if N is None and "none" not in (file.period, recorded.period):
            report_unstated_period(signals[:, roles["r"] or roles["u"]], log)
        elif N is not None and STOPPED not in repairs:
            n = len(gathered.signals)
            report_cut(int(n * N / (gathered.period or N)) - len(signals), n, N // 2 if recorded.half_wave else N, log)
        signals = without_step_images(signals, channels, roles, recorded, rate_hz, self.robot, log)
        signals, _ = on_one_side(channels, signals, to_joints(channels, self.robot))
        hold_lengths = hold_samples(recorded, channels, rate_hz)
        outputs, acting = (tuple(file.at.get(locations[i], locations[i]) for i in roles[role]) for role in ("y", "u"))
        has_at = any(f.at for f in recorded.files if f.configuration == file.configuration)
        inputs = recorded.places_of(file.configuration, "u") if has_at else acting
        u = np.zeros((len(signals), len(inputs)))  # a hammer is at one of its points
        u[:, [inputs.index(index) for index in acting]] = signals[:, roles["u"]]
        units = input_units(channels, self.robot) * (len(inputs) // len(acting))
        if recorded.has_no_torque:
            units = tuple(motion_unit("position", self.robot.slides(index)) for index in inputs)
            inputs = tuple(REFERENCE + index.partition(" ")[2] for index in inputs)
        return Record(
            name=experiment.name, configuration=experiment.configuration, realisation=experiment.realisation,
            experiment=experiment.experiment, rate_hz=rate_hz, period_samples=N or len(signals),
            is_periodic=N is not None, inputs=inputs, outputs=outputs,
            quantities=tuple(cast(Motion, channels[i].quantity) for i in roles["y"]), u=u, y=signals[:, roles["y"]],
            r=signals[:, roles["r"]] if roles["r"] else None,
            r_is_reference=bool(roles["r"]) and channels[roles["r"][0]].role == "reference",
            has_rate=gathered.log.rate_hz is not None, notes=log.findings.at(location),
            hold="zero-order" if any(hold_lengths) else "band-limited",
            hold_samples=() if set(hold_lengths) <= {0.0} or set(hold_lengths) == {1.0} else hold_lengths,
            half_wave=recorded.half_wave, repairs=dict(repairs),
            discarded_periods=tuple(log.findings.discarded_periods), sliding=self.robot.sliding((*inputs, *outputs)),
            input_units=units,
        )  # fmt: skip


def _columns_of_roles(channels: Sequence[ChannelSpec]) -> dict[str, list[int]]:
    """Return the columns of r, u and y; r in the order of the inputs that it acts on, or references in place of it."""
    roles = {role: [i for i, c in enumerate(channels) if c.role == role] for role in ("r", "u", "y", "reference")}
    inputs, references = [channels[j].at for j in roles["u"]], roles.pop("reference")
    if not inputs:
        roles["u"] = references
    elif not roles["r"] and {channels[i].at for i in references} == set(inputs):
        roles["r"] = references
    roles["r"].sort(key=lambda i: inputs.index(channels[i].at))
    return roles


def repair_signals(
    gathered: GatheredChannels, recorded: RecordedSpec, has_others: bool = False
) -> tuple[FloatArray, int | None, float]:
    """Return the repaired signals, the samples of their period (None without one), and their rate."""
    period, half_wave, log = gathered.period, recorded.half_wave, gathered.log
    if log.findings.repairs[SET_BACK]:
        text = "the time runs backwards, and the length of the gap there is unknown. Select one part by samples"
        raise log.error("records/clock", text)
    errors = [channel.errors for channel in gathered.channels]
    if period is None:
        signals = repair_without_period(gathered.signals, log)
        return before_channels(signals, gathered.rate_hz, errors), None, gathered.rate_hz
    N = grid_samples(period, half_wave)
    check = partial(check_repeat, N=N, half_wave=half_wave, log=log, has_others=has_others)
    signals = repair(gathered.signals, _columns_of_roles(gathered.channels), period, half_wave, log, check)
    rate_hz = gathered.rate_hz if period == N else gathered.rate_hz * N / period
    return before_channels(signals, rate_hz, errors), N, rate_hz


MIN_VALUES = 1 << 22  # a log of fewer is measured as a whole
_MIN_PERIODS = 8  # a median over fewer cannot distinguish a spike from a signal


def piece_bounds(n: int, N: int | None, n_channels: int) -> tuple[tuple[int, int], ...]:
    """Divide a log into pieces of whole periods N (None: any length), first to last sample; empty for a small log."""
    if n * n_channels < MIN_VALUES:
        return ()
    if N is None:
        count = -(-n * n_channels // large_arrays.PIECE_VALUES)
        return tuple(pairwise(i * n // count for i in range(count + 1)))
    # The first piece, which is repaired in full, is a short one; repairs take several times its memory.
    periods, remainder = max(_MIN_PERIODS, large_arrays.PIECE_VALUES // 4 // (N * n_channels)), n // N - _MIN_PERIODS
    starts = (_MIN_PERIODS + i * periods for i in range(max(1, remainder // periods)))
    return tuple(pairwise(N * p for p in (0, *starts, n // N))) if remainder >= _MIN_PERIODS else ()


def _has_lag(difference: FloatArray, mean: FloatArray) -> bool:
    """Return True if the lag between two mean periods (N,), samples, exceeds MAX_LAG and six standard deviations."""
    slope = np.gradient(np.pad(mean, 1, "wrap"))[1:-1]
    along, steepness = float(difference @ slope), float(slope @ slope)
    return (abs(along) > MAX_LAG * steepness) and along**2 * len(mean) > 36 * steepness * float(difference @ difference)


def join_pieces(
    measure: Callable[[int, int], Record], bounds: Sequence[tuple[int, int]], dtype: np.dtype[Any]
) -> Record | None:
    """Join the record of all pieces with signals in files; None if they are not synchronous.

    measure: the record of the samples from a first to before a last one.  dtype: of the numbers in the files.
    """
    n, first = bounds[-1][1], measure(*bounds[0])
    period = mean_period(_driver(first), first.period_samples) if first.is_periodic else None
    roles = {role: x for role in ("u", "y", "r") if (x := getattr(first, role)) is not None}
    signals = {role: large_arrays.empty_in_file((n, x.shape[1]), dtype) for role, x in roles.items()}
    notes, discarded = dict[Note, None](), list[int]()
    repairs: Counter[str] = Counter()
    for start, end in bounds:
        piece = measure(start, end) if start else first
        if piece.n_samples != end - start or not _is_in_step(piece, period):
            return None
        for role, signal in signals.items():
            signal[start:end] = getattr(piece, role)
            large_arrays.release(signal)
        notes |= dict.fromkeys(piece.notes)
        repairs.update(piece.repairs)
        discarded += [start // piece.repeat_samples + p for p in piece.discarded_periods]
    large = {role: LargeArray(x.shape, x.dtype, partial(_read_rows, x)) for role, x in signals.items()}
    period_samples = first.period_samples if first.is_periodic else n
    record = replace(first, **large, period_samples=period_samples)  # type: ignore[arg-type]
    return replace(record, notes=tuple(notes), repairs=dict(repairs), discarded_periods=tuple(discarded))


def _read_rows(signal: FloatArray, first: int, last: int) -> FloatArray:
    rows = np.array(signal[first:last])
    large_arrays.release(signal)
    return rows


def report_cut(excess: int, n: int, repeat: int, log: LogReport) -> None:
    """Report the samples of a log of n that are lost after its last whole repetition, if there are any."""
    text = f"the last {excess} of {n} samples are discarded, as they are no whole period of {repeat} samples"
    if excess > 0:
        log.note("records/corrected", text)


def _driver(record: Record) -> FloatArray:
    return record.u if record.r is None else record.r


def _is_in_step(piece: Record, first: FloatArray | None) -> bool:
    """Return True if a piece joins the first one, whose mean period is `first` (None without a period)."""
    if first is None:
        # An angle whose turns were taken out of one piece does not continue in the next.
        return all(note.code != UNWRAPPED for note in piece.notes)
    if RESAMPLED in piece.repairs:
        return False
    mean, N = mean_period(_driver(piece), len(first)), len(first)
    delays = [estimate_delay(a, b, N) for a, b in zip(first.T, mean.T, strict=True)]
    # The lag of a slow excitation is uncertain.
    return all(
        abs(lag) <= MAX_LAG or (abs(lag) < 1 and not _has_lag(b - a, a))
        for a, b, (lag, correlation) in zip(first.T, mean.T, delays, strict=True)
        if correlation >= MIN_DELAY_CORRELATION
    )
