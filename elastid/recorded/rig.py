"""A folder of lab logs as a rig: their channels as records in SI, on the link side, checked before use."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.experiment.plan.plan import Experiment, checked_configurations
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import ChannelSpec, FileSpec, RecordedSpec
from elastid.record import Motion, Record
from elastid.recorded.channels import GatheredChannels, gather_channels, period_samples
from elastid.recorded.files.formats import is_log
from elastid.recorded.link_side import link_side_factor, to_joints
from elastid.recorded.periodicity import repetition
from elastid.recorded.repair.delay import MIN_CORRELATION, delay
from elastid.recorded.repair.finding import Log, counts
from elastid.recorded.repair_order import repair
from elastid.recorded.torque_hold import check_holds, hold_samples
from elastid.robot import Robot

# A lag of u behind r, in samples, from which on it is reported.
_MIN_REPORTED_LAG = 0.75


@dataclass(frozen=True)
class RecordedRig:
    """Lab logs as a rig (see experiment.plan.rig); their paths are relative to base, the folder of the study.

    Raises StudyError where files, channels and robot do not fit together; measure raises DataError for a log that
    cannot be used.
    """

    robot: Robot
    spec: ExperimentSpec
    base: Path

    def __post_init__(self) -> None:
        """Check everything that needs no log."""
        checked_configurations(self.spec, self.robot)
        _check_files(self.spec, self._recorded.files, self.base)
        _check_channels(self._recorded.channels, self.robot)
        check_holds(self._recorded, self.robot)
        rate_hz = 1.0 if isinstance(self._recorded.rate_hz, str) else self._recorded.rate_hz
        samples = period_samples(self._recorded, rate_hz)
        if self._recorded.half_wave and samples % 2:
            raise StudyError(f"half_wave needs an even number of samples per period, not {samples}")

    @property
    def _recorded(self) -> RecordedSpec:
        return self.spec.as_recorded()

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """One for each file, in their order."""
        configurations = {c.name: c for c in checked_configurations(self.spec, self.robot)}
        files = self._recorded.files
        return tuple(Experiment(configurations[f.configuration], f.realisation, f.experiment) for f in files)

    def measure(self, experiment: Experiment) -> Record:
        """One experiment from its logs: channels in SI on the link side, repaired, in whole periods."""
        recorded = self._recorded
        file = recorded.files[[e.name for e in self.experiments].index(experiment.name)]
        gathered = gather_channels(recorded, file, self.base, self.robot)
        rate_hz = None if isinstance(recorded.rate_hz, str) else gathered.rate_hz
        log = Log(str(self.base / file.path), tuple(c.full_name for c in gathered.channels), rate_hz, gathered.first)
        record = _record(experiment, recorded, gathered, log, self.robot)
        return replace(record, sliding=self.robot.sliding((*record.inputs, *record.outputs)))


def _record(
    experiment: Experiment, recorded: RecordedSpec, gathered: GatheredChannels, log: Log, robot: Robot
) -> Record:
    channels, N = gathered.channels, gathered.period_samples
    roles = {role: [i for i, c in enumerate(channels) if c.role == role] for role in ("r", "u", "y")}
    at = [channel.at for channel in channels]
    # r in the order of the inputs that it acts on.
    roles["r"].sort(key=lambda i: [at[j] for j in roles["u"]].index(at[i]))

    def check(excitation: FloatArray) -> None:
        _check_repeat(excitation, recorded, N, log)

    drivers = np.array(roles["r"] or roles["u"])
    repaired = repair(gathered.signals, drivers, N, recorded.half_wave, log, check)
    signals, findings = repaired.signals, (*gathered.findings, *repaired.findings)
    where = f"record {experiment.name}"
    notes = [replace(note, place=where) for note in gathered.notes]
    notes += [finding.note(where) for finding in findings]
    notes += _lag_notes(channels, signals, N, where)
    lost = len(gathered.signals) - len(signals)
    if lost > 0:
        notes.append(
            Note(
                "incomplete-period",
                f"the last {lost} of {len(gathered.signals)} samples are no whole period of {_repeat(recorded, N)} "
                "samples and are left out",
                where,
            )
        )
    rate_is_known = not isinstance(recorded.rate_hz, str)
    signals = signals @ to_joints(channels, robot).T
    held = hold_samples(recorded, channels, gathered.rate_hz)
    alike = set(held) <= {0.0} or set(held) == {1.0}
    return Record(
        name=experiment.name,
        configuration=experiment.configuration,
        realisation=experiment.realisation,
        experiment=experiment.experiment,
        rate_hz=gathered.rate_hz,
        period_samples=N,
        inputs=tuple(at[i] for i in roles["u"]),
        outputs=tuple(at[i] for i in roles["y"]),
        quantities=tuple(cast(Motion, channels[i].quantity) for i in roles["y"]),
        u=signals[:, roles["u"]],
        y=signals[:, roles["y"]],
        r=signals[:, roles["r"]] if roles["r"] else None,
        rate_is_known=rate_is_known,
        notes=tuple(notes),
        hold="zero-order" if any(held) else "band-limited",
        hold_samples=() if alike else held,
        half_wave=recorded.half_wave,
        repairs=counts(findings),
        left_out=repaired.left_out,
    )


def _lag_notes(channels: tuple[ChannelSpec, ...], signals: FloatArray, N: int, where: str) -> list[Note]:
    """A note on each u that lags r: a delay of the drive, or of one of the two channels."""
    notes = []
    u = {c.at: i for i, c in enumerate(channels) if c.role == "u"}
    for i, channel in enumerate(channels):
        if channel.role != "r":
            continue
        lag, correlation = delay(signals[:, i], signals[:, u[channel.at]], N)
        if correlation >= MIN_CORRELATION and abs(lag) >= _MIN_REPORTED_LAG:
            said = (
                f"u at {channel.at} lags r by {lag:.1f} samples; responses of y to u do not depend on it, those "
                "estimated with the reference only if it changes from experiment to experiment"
            )
            notes.append(Note("late-torque", said, where))
    return notes


def _repeat(recorded: RecordedSpec, N: int) -> int:
    return N // 2 if recorded.half_wave else N


def _check_repeat(excitation: FloatArray, recorded: RecordedSpec, period: int, log: Log) -> None:
    """DataError where the excitation (n, n_u) does not repeat as stated, or holds less than two repetitions."""
    n, path = len(excitation), log.where
    repeat, sign = _repeat(recorded, period), -1 if recorded.half_wave else 1
    if n < 2 * repeat:
        needed = "one period is" if recorded.half_wave else "two periods are"
        raise DataError(
            f"{path}: {_span(n, log)} are {n / period:.3g} periods of {_span(period, log)}; at least "
            f"{needed} needed{_half_wave_hint(excitation, period, recorded, log)}"
        )
    found = repetition(excitation, repeat, sign)
    if found.is_as_stated:
        return
    stated = "second half minus first" if recorded.half_wave else "one period to the next"
    problem = (
        f"{path}: the excitation does not repeat with the period of {_span(period, log)} that the study states "
        f"(correlation {found.correlation:.3f}, {stated})"
    )
    if found.best_samples:
        raise DataError(
            f"{problem}; it repeats every {_span(found.best_samples, log)} (correlation "
            f"{found.best_correlation:.3f}): correct the period or the rate"
        )
    raise DataError(
        f"{problem}, nor at any other lag (best correlation {found.best_correlation:.3f})"
        f"{_half_wave_hint(excitation, 2 * repeat, recorded, log)}; elastid needs a periodic excitation"
    )


def _half_wave_hint(excitation: FloatArray, period: int, recorded: RecordedSpec, log: Log) -> str:
    """The end of a message where the second half of a period is minus its first, so that one period is enough."""
    if recorded.half_wave or period % 2 or len(excitation) < period:
        return ""
    if not repetition(excitation[:period], period // 2, sign=-1).is_as_stated:
        return ""
    return (
        f". The second half of {_span(period, log)} is minus the first: with period_samples: {period} and "
        "half_wave: true one period is enough"
    )


def _span(samples: float, log: Log) -> str:
    shown = round(samples, 2)
    seconds = "" if log.rate_hz is None else f" ({shown / log.rate_hz:.6g} s)"
    return f"{shown:.8g} samples{seconds}"


def _check_files(spec: ExperimentSpec, files: tuple[FileSpec, ...], base: Path) -> None:
    seen: dict[tuple[str, int, int], str] = {}
    for file in files:
        if file.configuration not in spec.configurations:
            raise StudyError(
                f"file {file.path}: configuration '{file.configuration}' is not under experiment.configurations; "
                f"there are {', '.join(spec.configurations)}"
            )
        key = (file.configuration, file.realisation, file.experiment)
        if key in seen:
            raise StudyError(
                f"files {seen[key]} and {file.path} are both configuration {key[0]}, realisation {key[1]}, experiment "
                f"{key[2]}; give each its own numbers (experiment: same phases or another input; realisation: other "
                "phases)"
            )
        seen[key] = file.path
        for path in (file.path, *file.also):
            if not is_log(base / path):
                raise StudyError(f"log file {base / path} is not there; paths are relative to the study's folder")


def _check_channels(channels: tuple[ChannelSpec, ...], robot: Robot) -> None:
    for channel in channels:
        robot.check_location(channel.at)
        link_side_factor(channel, robot)
        if channel.role in ("r", "u") and channel.at not in robot.motor_locations:
            raise StudyError(
                f"channel {channel.name_in_file}: {channel.role} acts at '{channel.at}', where no motor is; "
                f"there are {', '.join(robot.motor_locations)}"
            )
    to_joints(channels, robot)
    places = {role: [c.at for c in channels if c.role == role] for role in ("r", "u", "y")}
    # r may be in several files, which are aligned by it.
    signals = [(c.role, c.at, c.file if c.role == "r" else 1) for c in channels]
    for role, at, _ in signals:
        if signals.count((role, at, 1)) > 1:
            raise StudyError(f"two channels have role {role} at {at}; keep one of them")
    if places["r"] and set(places["r"]) != set(places["u"]):
        raise StudyError(
            f"channels with role r act at {', '.join(places['r'])}, those with role u at {', '.join(places['u'])}; "
            "list r for every input or for none"
        )
