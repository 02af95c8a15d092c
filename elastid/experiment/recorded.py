"""The rig that is a folder of lab logs: their channels as records in SI, on the link side, checked before use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from elastid.arrays import FloatArray
from elastid.errors import DataError, StudyError
from elastid.experiment.log_files import described, read_channels
from elastid.experiment.periodicity import repetition
from elastid.experiment.plan import Experiment, checked_configurations
from elastid.experiment.signals import check_values, link_side, link_side_factor
from elastid.experiment.spec import ChannelSpec, ExperimentSpec, FileSpec, RecordedSpec
from elastid.record import Motion, Record
from elastid.robot import Robot


@dataclass(frozen=True)
class RecordedRig:
    """Lab logs as a rig (see experiment.rig); their paths count from base, the folder of the study.

    Raises StudyError where files, channels and robot do not fit together; measure raises DataError for a log that
    cannot be used.
    """

    robot: Robot
    spec: ExperimentSpec
    base: Path

    def __post_init__(self) -> None:
        """Check all that can be checked without reading a log."""
        checked_configurations(self.spec, self.robot)
        _check_files(self.spec, self._recorded.files, self.base)
        _check_channels(self._recorded.channels, self.robot)
        if self._recorded.half_wave and _period_samples(self._recorded) % 2:
            raise StudyError(
                f"half_wave needs an even number of samples per period, not {_period_samples(self._recorded)}"
            )

    @property
    def _recorded(self) -> RecordedSpec:
        if self.spec.recorded is None:
            raise StudyError("the experiment of this study is not recorded; give experiment.recorded")
        return self.spec.recorded

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """One for each file, in their order."""
        configurations = {c.name: c for c in checked_configurations(self.spec, self.robot)}
        files = self._recorded.files
        return tuple(Experiment(configurations[f.configuration], f.realisation, f.experiment) for f in files)

    def measure(self, experiment: Experiment) -> Record:
        """Read one log: its channels in SI on the link side, whole periods only."""
        recorded = self._recorded
        file = recorded.files[[e.name for e in self.experiments].index(experiment.name)]
        path = self.base / file.path
        values, first = _cut(read_channels(path, recorded.channels, recorded.text), file, path)
        rate_hz = None if isinstance(recorded.rate_hz, str) else recorded.rate_hz
        still = check_values(recorded.channels, values, first, path, rate_hz)
        signals, words = zip(
            *(link_side(c, v, self.robot) for c, v in zip(recorded.channels, values.T, strict=True)), strict=True
        )
        notes = tuple(f"record {experiment.name}: {word}" for word in (*still, *words) if word)
        return _record(experiment, recorded, np.stack(signals, axis=1), notes, path)


def _record(
    experiment: Experiment, recorded: RecordedSpec, signals: FloatArray, notes: tuple[str, ...], path: Path
) -> Record:
    roles = {role: [i for i, c in enumerate(recorded.channels) if c.role == role] for role in ("r", "u", "y")}
    at = [channel.at for channel in recorded.channels]
    # r in the order of the inputs that it acts on.
    roles["r"].sort(key=lambda i: [at[j] for j in roles["u"]].index(at[i]))
    excitation = signals[:, roles["r"] or roles["u"]]
    repeat = _checked_repeat(excitation, recorded, path)
    n = len(signals) // repeat * repeat
    if n < len(signals):
        notes += (
            f"record {experiment.name}: the last {len(signals) - n} of {len(signals)} samples are no whole period of "
            f"{repeat} samples and are left out",
        )
    rate_is_known = not isinstance(recorded.rate_hz, str)
    return Record(
        name=experiment.name,
        configuration=experiment.configuration,
        realisation=experiment.realisation,
        experiment=experiment.experiment,
        rate_hz=float(recorded.rate_hz) if rate_is_known else 1.0,
        period_samples=_period_samples(recorded),
        inputs=tuple(at[i] for i in roles["u"]),
        outputs=tuple(at[i] for i in roles["y"]),
        quantities=tuple(cast(Motion, recorded.channels[i].quantity) for i in roles["y"]),
        u=signals[:n, roles["u"]],
        y=signals[:n, roles["y"]],
        r=signals[:n, roles["r"]] if roles["r"] else None,
        rate_is_known=rate_is_known,
        notes=notes,
        half_wave=recorded.half_wave,
    )


def _period_samples(recorded: RecordedSpec) -> int:
    if recorded.period_samples is not None:
        return recorded.period_samples
    return round(cast(float, recorded.period) * float(recorded.rate_hz))


def _checked_repeat(excitation: FloatArray, recorded: RecordedSpec, path: Path) -> int:
    """After how many samples the excitation (n, n_u) repeats; DataError where it does not, or is too short for two."""
    n, period = len(excitation), _period_samples(recorded)
    repeat, sign = (period // 2, -1) if recorded.half_wave else (period, 1)
    if n < 2 * repeat:
        needed = "one period is" if recorded.half_wave else "two periods are"
        raise DataError(
            f"{path}: {_span(n, recorded)} are {n / period:.3g} periods of {_span(period, recorded)}; at least "
            f"{needed} needed{_half_wave_hint(excitation, period, recorded)}"
        )
    found = repetition(excitation, repeat, sign)
    if found.is_as_stated:
        return repeat
    stated = "second half minus first" if recorded.half_wave else "one period to the next"
    problem = (
        f"{path}: the excitation does not repeat with the period of {_span(period, recorded)} that the study states "
        f"(correlation {found.correlation:.3f}, {stated})"
    )
    if found.best_samples:
        raise DataError(
            f"{problem}; it repeats every {_span(found.best_samples, recorded)} (correlation "
            f"{found.best_correlation:.3f}): correct the period or the rate"
        )
    raise DataError(
        f"{problem}, nor at any other lag (best correlation {found.best_correlation:.3f})"
        f"{_half_wave_hint(excitation, 2 * repeat, recorded)}; elastid needs a periodic excitation"
    )


def _half_wave_hint(excitation: FloatArray, period: int, recorded: RecordedSpec) -> str:
    """Say so where the second half of a period is minus its first, which one period is then enough for."""
    if recorded.half_wave or period % 2 or len(excitation) < period:
        return ""
    if not repetition(excitation[:period], period // 2, sign=-1).is_as_stated:
        return ""
    return (
        f". The second half of {_span(period, recorded)} is minus the first: with period_samples: {period} and "
        "half_wave: true one period is enough"
    )


def _span(samples: float, recorded: RecordedSpec) -> str:
    shown = round(samples, 2)
    seconds = "" if isinstance(recorded.rate_hz, str) else f" ({shown / recorded.rate_hz:.6g} s)"
    return f"{shown:.8g} samples{seconds}"


def _cut(values: FloatArray, file: FileSpec, path: Path) -> tuple[FloatArray, int]:
    if file.samples is None:
        return values, 0
    first, last = file.samples
    if not 0 <= first < last <= len(values):
        raise DataError(
            f"{path}: samples [{first}, {last}] do not lie in it; it has {len(values)} samples, the first is 0 and "
            "last is not included"
        )
    return values[first:last], first


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
                f"{key[2]}; number them apart (experiment: same phases or another input; realisation: other phases)"
            )
        seen[key] = file.path
        if not (base / file.path).is_file():
            raise StudyError(f"log file {base / file.path} is not there; paths count from the study's folder")


def _check_channels(channels: tuple[ChannelSpec, ...], robot: Robot) -> None:
    for channel in channels:
        robot.check_location(channel.at)
        link_side_factor(channel, robot)
        if channel.role in ("r", "u") and channel.at not in robot.motor_locations:
            raise StudyError(
                f"channel {described(channel)}: {channel.role} acts at '{channel.at}', where no motor is; "
                f"there are {', '.join(robot.motor_locations)}"
            )
    places = {role: [c.at for c in channels if c.role == role] for role in ("r", "u", "y")}
    for role, at in places.items():
        twice = [place for place in at if at.count(place) > 1]
        if twice:
            raise StudyError(f"two channels have role {role} at {twice[0]}; list the one to use")
    if places["r"] and set(places["r"]) != set(places["u"]):
        raise StudyError(
            f"channels with role r act at {', '.join(places['r'])}, those with role u at {', '.join(places['u'])}; "
            "list r for every input or for none"
        )
