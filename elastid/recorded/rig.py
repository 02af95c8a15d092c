"""A folder of lab logs as a rig: their channels as records in SI, on the link side, checked before use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from elastid.base.errors import DataError, StudyError
from elastid.experiment.plan.plan import Experiment, checked_configurations
from elastid.experiment.specs.channels import ChannelSpec, Places, input_units
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.record import Configuration, Motion, Record
from elastid.recorded.channels import GatheredChannels, gather_channels
from elastid.recorded.evidence import drive_notes, same_signal_notes
from elastid.recorded.files.formats import is_log, is_single, naming, rows_of
from elastid.recorded.link_side import (
    channel_refusals,
    disturbances,
    hold_samples,
    link_side_factor,
    to_joints,
)
from elastid.recorded.pieces import end_notes, joined, joined_periods, may_be_large, pieces
from elastid.recorded.repair import Log, Repaired, counts
from elastid.recorded.repair.masks import STOPPED
from elastid.recorded.repair.missing import repair, repair_without_period
from elastid.recorded.repair.periodicity import check_repeat, grid_samples, unstated_period_notes


@dataclass(frozen=True)
class RecordedRig:
    """Lab logs as a rig (see experiment.plan.rig); their paths are relative to base, the folder of the study.

    StudyError where files, channels and robot do not fit together; `measure`: DataError for a log that is of no use.
    """

    robot: Places
    spec: ExperimentSpec
    base: Path

    def __post_init__(self) -> None:
        checked_configurations(self.spec, self.robot)
        _check_files(self.spec, self._recorded, self.base)
        _check_channels(self._recorded.channels, self.robot)
        for file in self._recorded.files:
            samples = self._recorded.period_of(file)
            if self._recorded.half_wave and isinstance(samples, float) and samples % 2 == 1:
                raise StudyError(
                    "study/recorded", f"half_wave needs an even number of samples per period, not {samples:g}"
                )

    @property
    def _recorded(self) -> RecordedSpec:
        return self.spec.as_recorded()

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """One for each file, in their order; files of the same numbers hold further periods of its excitation."""
        configurations = {c.name: c for c in self._configurations}
        runs = {file.run: configurations[file.configuration] for file in self._recorded.files}
        return tuple(Experiment(replace(posture, name=name), *numbers) for (name, *numbers), posture in runs.items())

    @property
    def _configurations(self) -> tuple[Configuration, ...]:
        return tuple(checked_configurations(self.spec, self.robot))

    def measure(self, experiment: Experiment) -> Record:
        """One experiment from its logs: channels in SI on the link side, repaired, in whole periods."""
        files, records = self._files(experiment), []
        for file in files:
            path = self.base / file.path
            with naming(path, f"its values cannot be used as a log; look at them with `elastid inspect {path}`"):
                record = self._in_pieces(experiment, file) if len(files) == 1 else None
                records.append(record or self._as_a_whole(experiment, file, len(files) > 1))
        return records[0] if len(records) == 1 else joined_periods(records, [file.path for file in files])

    def is_large(self, experiment: Experiment) -> bool:
        """True if the log of an experiment is measured in pieces, with what its record is made of left in it."""
        files = self._files(experiment)
        return len(files) == 1 and bool(self._pieces(files[0]))

    def _files(self, experiment: Experiment) -> list[FileSpec]:
        """Files of the periods of an experiment, mostly one."""
        run = (experiment.configuration.name, experiment.realisation, experiment.experiment)
        return [file for file in self._recorded.files if file.run == run]

    def _pieces(self, file: FileSpec) -> tuple[tuple[int, int], ...]:
        """First and last sample, of those that are used, of each piece of a log; none where it is read as a whole."""
        recorded, path, period = self._recorded, self.base / file.path, self._recorded.period_of(file)
        is_mixed = any(channel.rate_hz is not None or channel.role == "d" for channel in recorded.channels)
        needs_all = period == "find" or (period or 0) % 1 or recorded.time or file.also or is_mixed
        if needs_all or not may_be_large(path):
            return ()
        n = rows_of(path, recorded.channels, recorded.text) or 0
        start, end = file.samples or (0, n)
        is_inside = 0 <= start < end <= n
        return pieces(end - start, None if period is None else int(period), len(recorded.channels)) if is_inside else ()

    def _in_pieces(self, experiment: Experiment, file: FileSpec) -> Record | None:
        """The record of a log that is too large for memory; None where it is not, or must be read as a whole."""
        bounds = self._pieces(file)
        if not bounds:
            return None
        recorded, path = self._recorded, self.base / file.path
        n = rows_of(path, recorded.channels, recorded.text) or 0
        start, end = file.samples or (0, n)

        def measured(first: int, last: int) -> Record:
            return self._as_a_whole(experiment, replace(file, samples=(start + first, start + last)))

        dtype = np.dtype(np.float32 if is_single(path, recorded.channels, recorded.text) else np.float64)
        try:
            record = joined(measured, bounds, dtype)
        except DataError:
            # Reading all of it shows if that piece spoils the record.
            return None
        if record is None:
            return None
        lost = end - start - record.n_samples
        notes = end_notes(lost, end - start, record.repeat_samples, f"record {record.name}")
        return replace(record, notes=(*record.notes, *notes))

    def _as_a_whole(self, experiment: Experiment, file: FileSpec, is_one_of_several: bool = False) -> Record:
        recorded = self._recorded
        gathered = gather_channels(recorded, file, self.base, self.robot)
        channels, where = gathered.channels, f"record {experiment.name}"
        where += f", {file.path}" if is_one_of_several else ""
        known_hz = None if isinstance(recorded.rate_hz, str) else gathered.rate_hz
        log = Log(
            str(self.base / file.path), tuple(c.full_name for c in channels), known_hz, gathered.first, gathered.rows
        )
        roles, places = _columns_of_roles(channels), [channel.at for channel in channels]
        repaired, N, rate_hz = repaired_signals(gathered, roles, recorded, log, is_one_of_several)
        signals, findings = repaired.signals, (*gathered.findings, *repaired.findings)
        notes = [replace(note, place=where) for note in gathered.notes]
        notes += [finding.note(where) for finding in findings]
        notes += [*drive_notes(channels, signals, N, where), *same_signal_notes(channels, signals, where)]
        if N is not None:
            n = len(gathered.signals)
            lost = int(n * N / (gathered.period or N)) - len(signals)
            if all(finding.kind != STOPPED for finding in repaired.findings):
                notes += end_notes(lost, n, N // 2 if recorded.half_wave else N, where)
        elif "none" not in (file.period, recorded.period):
            notes += unstated_period_notes(signals[:, roles["r"] or roles["u"]], where)
        T = to_joints(channels, self.robot)
        signals = signals if np.array_equal(T, np.eye(len(T))) else signals @ T.T
        if any(channel.role == "d" for channel in channels):
            signals = signals.copy()
            signals[:, roles["u"]] += disturbances(channels, signals, [places[i] for i in roles["u"]])
        held = hold_samples(recorded, channels, rate_hz)
        inputs, outputs = (tuple(places[i] for i in roles[role]) for role in ("u", "y"))
        return Record(
            name=experiment.name,
            configuration=experiment.configuration,
            realisation=experiment.realisation,
            experiment=experiment.experiment,
            rate_hz=rate_hz,
            period_samples=N or len(signals),
            is_periodic=N is not None,
            inputs=inputs,
            outputs=outputs,
            quantities=tuple(cast(Motion, channels[i].quantity) for i in roles["y"]),
            u=signals[:, roles["u"]],
            y=signals[:, roles["y"]],
            r=signals[:, roles["r"]] if roles["r"] else None,
            rate_is_known=known_hz is not None,
            notes=tuple(notes),
            hold="zero-order" if any(held) else "band-limited",
            hold_samples=() if set(held) <= {0.0} or set(held) == {1.0} else held,
            half_wave=recorded.half_wave,
            repairs=counts(findings),
            left_out=repaired.left_out,
            sliding=self.robot.sliding((*inputs, *outputs)),
            input_units=input_units(channels, self.robot),
        )


def _columns_of_roles(channels: Sequence[ChannelSpec]) -> dict[str, list[int]]:
    """The columns of r, u and y; r in the order of the inputs that it acts on."""
    roles = {role: [i for i, c in enumerate(channels) if c.role == role] for role in ("r", "u", "y")}
    roles["r"].sort(key=lambda i: [channels[j].at for j in roles["u"]].index(channels[i].at))
    return roles


def repaired_signals(
    gathered: GatheredChannels,
    roles: Mapping[str, Sequence[int]],
    recorded: RecordedSpec,
    log: Log,
    is_one_of_several: bool = False,
) -> tuple[Repaired, int | None, float]:
    """The repaired signals, the samples of their period (None without one), and their rate."""
    period, half_wave = gathered.period, recorded.half_wave
    if period is None:
        return repair_without_period(gathered.signals, log), None, gathered.rate_hz
    N = grid_samples(period, half_wave)
    check = partial(check_repeat, N=N, half_wave=half_wave, log=log, is_one_of_several=is_one_of_several)
    repaired = repair(gathered.signals, roles, period, half_wave, log, check)
    return repaired, N, gathered.rate_hz if period == N else gathered.rate_hz * N / period


def _check_files(spec: ExperimentSpec, recorded: RecordedSpec, base: Path) -> None:
    for number, file in enumerate(recorded.files):
        if file.configuration not in spec.configurations:
            raise StudyError(
                "study/recorded",
                f"configuration '{file.configuration}' is not under experiment.configurations; "
                f"there are {', '.join(spec.configurations) or 'none'}",
                f"file {file.path}",
            )
        if refused := recorded.repeat_refusal(number):
            raise StudyError("study/recorded", refused, f"file {file.path}")
        for path in (file.path, *file.also):
            if not is_log(base / path):
                raise StudyError(
                    "files/missing", f"log file {base / path} is not there; paths are relative to the study's folder"
                )


def _check_channels(channels: tuple[ChannelSpec, ...], robot: Places) -> None:
    for i, _, text in channel_refusals(channels, robot):
        raise StudyError("study/recorded", text, channels[i].full_name)
    for channel in channels:
        link_side_factor(channel, robot)
    to_joints(channels, robot)
