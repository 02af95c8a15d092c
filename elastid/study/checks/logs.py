"""The sections `experiment.recorded` and `experiment.responses` against robot and disk: files and channels.

The section `experiment.recorded` against its logs, opened: channels, rate, period, length, units, signs, order.
"""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError, did_you_mean
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ToolSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec, ResponseFileSpec, ResponsesSpec
from elastid.logs.channel_doubts import channel_doubts
from elastid.logs.channels import excitation_columns, gather_channels
from elastid.logs.clocks import MAX_SAMPLES, RUNS_BACKWARDS, is_clock, read_stamps, stamp_rate, stamp_size, time_units
from elastid.logs.files.formats import is_log, open_log
from elastid.logs.files.log import Log
from elastid.logs.files.text_format import FORMAT_HINT
from elastid.logs.headings import is_time
from elastid.logs.repair import LogReport
from elastid.logs.repair.periodicity import check_complete, check_repeat, grid_samples
from elastid.logs.repair.time_stamps import without_jumps
from elastid.logs.units_and_sides import find_channel_errors, without_placeholders
from elastid.store.files import content_hash
from elastid.study.checks.names import refusal_of, unknown
from elastid.study.messages import NO_LOG, Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

# Methods that need no period.
WITHOUT_PERIOD = ("auto", "local_polynomial", "local_rational", "h1")
_RECORDED: KeyPath = ("experiment", "recorded")


def check_measured(study: Study, base: Path) -> Iterator[Problem]:
    """Yield problems of the sections that name files of measurements: logs, responses, and responses at the tool."""
    experiment = study.experiment
    if experiment.recorded is not None:
        yield from _check_recorded(study, experiment.recorded, base)
    if experiment.responses is not None:
        yield from _check_responses(study, experiment.responses, base)
    tools: tuple[tuple[KeyPath, ToolSpec | None], ...]
    tools = (("validation", "tool"), study.validation.tool), (("tool",), study.tool)
    for section, tool in tools if study.robot is not None else ():
        if tool is not None:
            yield from _check_tool(study, tool, base, section)


def _check_recorded(study: Study, recorded: RecordedSpec, base: Path) -> Iterator[Problem]:
    """Check that log files exist, channels and robot fit, and the estimation method suits the period."""
    path = _RECORDED
    yield from check_files(study, recorded.files, path, base)
    yield from check_channels(study, recorded.channels, path)
    without = [file.path for file in recorded.files if recorded.period_of(file) is None]
    if without and study.estimator.method not in WITHOUT_PERIOD:
        message = f"{study.estimator.method} compares periods, and {without[0]} has no period. Give"
        advice = "experiment.recorded.period (a time, or find), or choose a method without periods"
        yield Problem(("estimator", "method"), f"{message} {advice}: {', '.join(WITHOUT_PERIOD)}")
    yield from check_controller(study, recorded)
    if recorded.has_no_torque and study.robot is None:
        message = "no channel has role u (an input). Add the torques, or robot: references alone need its model"
        yield Problem((*path, "channels"), message)
    if recorded.has_no_torque and study.gears is not None:
        yield Problem(("gears",), "effects of gears need torques, and no channel has role u. Add them, or remove gears")
    inputs = [channel for channel in recorded.channels if channel.role in ("u", "r", "reference")]
    locations = [channel.at for channel in recorded.channels]
    for i, file in enumerate(recorded.files):
        for at in file.at:
            if at not in locations:
                yield unknown((*path, "files", i, "at"), "location of a channel", at, locations)
        if file.at and (len(inputs) != 1 or study.robot is not None):
            message = "a hammer or sensors move in studies without robot and with one input. Write a configuration each"
            yield Problem((*path, "files", i, "at"), message)
        if refusal := recorded.repeat_refusal(i):
            yield Problem((*path, "files", i), refusal)


def check_controller(study: Study, recorded: RecordedSpec) -> Iterator[Problem]:
    """Check gains for each driven joint; `elastid loops` reads them."""
    if recorded.controller is not None and study.robot is not None:
        rate_hz = recorded.controller.tick_hz or recorded.known_rate_hz
        for keys, refusal in recorded.controller.refusals(study.robot.driven_names, rate_hz):
            yield Problem((*_RECORDED, "controller", *keys), refusal)


def _check_responses(study: Study, responses: ResponsesSpec, base: Path) -> Iterator[Problem]:
    """Check that there is one response file for each configuration, and that channels and robot fit."""
    path = ("experiment", "responses")
    yield from check_files(study, responses.files, path, base)
    yield from check_channels(study, responses.channels, path)
    claimed: dict[str, str] = {}
    for i, file in enumerate(responses.files):
        if file.configuration in claimed:
            text = f"{claimed[file.configuration]} and {file.path} both belong to configuration {file.configuration};"
            advice = "each has one response. Omit one, or give it its own configuration"
            yield Problem((*path, "files", i), f"{text} {advice}")
        claimed[file.configuration] = file.path


def check_files(
    study: Study, files: Sequence[FileSpec | ResponseFileSpec], path: KeyPath, base: Path
) -> Iterator[Problem]:
    """Check that files and their configurations exist, and that each configuration has a file, except for friction."""
    for i, file in enumerate(files):
        yield from _check_file(study, file, (*path, "files", i), base)
    tools = filter(None, (study.tool, study.validation.tool))
    with_tool = {file.configuration for tool in tools for file in tool.responses.files}
    for name in study.experiment.configurations if study.friction is None else ():
        if name not in {file.configuration for file in files} | with_tool:
            message = f"no file belongs to configuration {name}. List one in {'.'.join(map(str, path))}.files"
            yield Problem(("experiment", "configurations", name), message, at_key=True)


def _check_file(study: Study, file: FileSpec | ResponseFileSpec, path: KeyPath, base: Path) -> Iterator[Problem]:
    names, name, place = study.experiment.configurations, file.configuration, base / file.path
    if not is_log(place):
        neighbours = sorted(os.listdir(place.parent)) if os.path.isdir(place.parent) else []
        hint = did_you_mean(place.name, neighbours[:20]) if neighbours else "copy the log there, or correct the path"
        yield Problem((*path, "path"), f"{NO_LOG} (looked for {place}); {hint}")
    if not name and study.friction is None:
        yield Problem((*path, "configuration"), "this key is required", at_key=True)
    elif name and name not in names:
        yield unknown((*path, "configuration"), "configuration", name, names)


def _check_tool(study: Study, tool: ToolSpec, base: Path, section: KeyPath) -> Iterator[Problem]:
    path = (*section, "responses")
    for i, file in enumerate(tool.responses.files):
        yield from _check_file(study, file, (*path, "files", i), base)
    robot = study.as_robot()
    inputs = robot.load_locations
    if tool.stiffness and len(tool.stiffness) != robot.n_u:
        message = f"{len(tool.stiffness)} drives for {robot.n_u} driven joints of robot {robot.name}"
        yield Problem((*section, "stiffness"), message + ". Give one per joint")
    for i, channel in enumerate(tool.responses.channels):
        key_path = (*path, "channels", i)
        if channel.role == "u" and channel.at not in inputs:
            yield unknown((*key_path, "at"), "input", channel.at, inputs)
        elif channel.role == "y":
            if refusal := refusal_of(robot.check_location, channel.at):
                yield Problem((*key_path, "at"), refusal)
            if tool.motors == "locked" and channel.at.startswith("motor "):
                yield Problem((*key_path, "at"), f"{channel.at} is locked and does not move. Omit it")
        elif channel.quantity != ("force" if channel.at.startswith("force ") else "torque"):
            kind = channel.at.partition(" ")[0]
            message = f"the channel contains a {channel.quantity}, and a {kind} acts at {channel.at}"
            yield Problem((*key_path, "quantity"), f"{message}. Set quantity: {kind}")


def check_channels(study: Study, channels: Sequence[ChannelSpec], path: KeyPath) -> Iterator[Problem]:
    """Check that channels are on the robot, have units of their quantity, and are different signals."""
    for i, key, text in find_channel_errors(channels, study.places):
        yield Problem((*path, "channels", i, key), text)


# Logs that are opened, over the list; bytes of logs of one experiment whose start times are compared.
_MAX_LOGS, _MAX_BYTES = 12, 1 << 26


def check_logs(study: Study, base: Path) -> Iterator[Problem]:
    """Yield each contradiction between a valid study and its logs once. base: folder of their paths."""
    recorded, contents = study.experiment.as_recorded(), set[tuple[object, ...]]()
    for i, file in enumerate(recorded.files):
        source = base / file.path
        samples = content_hash(source) if source.is_file() else file.path, file.samples
        if samples in contents:
            yield Problem((*_RECORDED, "files", i, "path"), "samples identical to another log, without noise")
        contents.add(samples)
    selection = np.unique(np.linspace(0, len(recorded.files) - 1, _MAX_LOGS).astype(int))
    problems: dict[KeyPath, Problem] = {}
    counts: Counter[KeyPath] = Counter()
    for i in map(int, selection):
        for problem in _check_log(study, recorded, i, base):
            problems.setdefault(problem.path, problem)
            counts[problem.path] += 1
    min_count = min(2, len(selection))
    yield from (p for p in problems.values() if not p.is_weak or counts[p.path] >= min_count)
    if problems or study.friction is not None:
        return
    # The logs of one experiment have a common signal or clock, which the stage measure needs.
    for i, file in [(i, file) for i, file in enumerate(recorded.files) if file.also][:1]:
        n_bytes = sum((base / name).stat().st_size for name in (file.path, *file.also))
        refusal = "" if n_bytes > _MAX_BYTES else refusal_of(gather_channels, recorded, file, base, study.places)
        yield from [Problem((*_RECORDED, "files", i, "also"), refusal)] if refusal else []


def _check_log(study: Study, recorded: RecordedSpec, i: int, base: Path) -> Iterator[Problem]:
    file, path = recorded.files[i], (*_RECORDED, "files", i)
    for number, name in enumerate((file.path, *file.also), start=1):
        key_path = (*path, "path") if number == 1 else (*path, "also", number - 2)
        if not is_log(base / name):
            yield Problem(key_path, f"no such file (looked for {base / name})")
            continue
        members = [k for k, channel in enumerate(recorded.channels) if channel.file == number]
        try:
            with open_log(base / name, recorded.text) as log:
                absences = list(_check_names(log, recorded, members))
                yield from absences
                if number == 1 and not absences:
                    yield from _check_content(study, recorded, file, path, log, base / name)
        except ElastidError as error:
            yield Problem((*_RECORDED, "text") if FORMAT_HINT in str(error) else key_path, str(error))


def _check_names(log: Log, recorded: RecordedSpec, members: Sequence[int]) -> Iterator[Problem]:
    """Yield channels that are missing in their file; DataError if all are."""
    first = slice(0, 2)
    refusals = [(k, text) for k in members if (text := refusal_of(log.values, [recorded.channels[k]], first))]
    if refusals and len(refusals) == len(members):
        log.values([recorded.channels[k] for k in members], first)
    for k, refusal in refusals:
        key = "column" if recorded.channels[k].channel in ("", *log.shapes()) else "channel"
        yield Problem((*_RECORDED, "channels", k, key), refusal)
    if recorded.time and recorded.time not in log.shapes():
        message = f"the log has no such channel; {did_you_mean(recorded.time, list(log.shapes()))}"
        yield Problem((*_RECORDED, "time"), message)


def _check_content(
    study: Study, recorded: RecordedSpec, file: FileSpec, path: KeyPath, log: Log, place: Path
) -> Iterator[Problem]:
    members = [k for k, c in enumerate(recorded.channels) if c.file == 1 and c.rate_hz is None]
    members = [k for k in members if log.time_of(recorded.channels[k]) == log.time_of(recorded.channels[members[0]])]
    channels = [recorded.channels[k] for k in members]
    first, end = file.samples or (0, None)
    period = recorded.period_of(file)
    max_samples = max(MAX_SAMPLES, int(4 * period) if isinstance(period, float) else 0)
    span = slice(first, first + max_samples if end is None else min(end, first + max_samples))
    values = without_placeholders(log.values(channels, span))
    if end is not None and len(values) < min(end - first, max_samples):
        text = f"the log ends after sample {first + len(values)}, counted from 0. Correct samples"
        yield Problem((*path, "samples"), text)
        return
    rates = list(_check_rate(recorded, log))
    yield from rates
    if isinstance(period, float) and not rates and not recorded.time and len(values) > 1:
        yield from _check_period(recorded, file, path, values[:, excitation_columns(channels)], period, place)
    if recorded.rate_hz != "unknown":
        doubts = channel_doubts(channels, values, recorded.known_rate_hz, study.places)
        for doubt in (doubt for doubt in doubts if not rates or doubt.channel is not None):
            at = ("rate_hz",) if doubt.channel is None else ("channels", members[doubt.channel], doubt.key)
            yield Problem((*_RECORDED, *at), f"{doubt.text} ({place.name})", is_weak=doubt.is_weak)


def _check_period(
    recorded: RecordedSpec, file: FileSpec, path: KeyPath, drivers: FloatArray, period: float, place: Path
) -> Iterator[Problem]:
    """Check whole periods as the stage measure does; it resamples other periods before the check."""
    if period != round(period) or not drivers.size:
        return
    known_hz = None if recorded.rate_hz == "unknown" else recorded.known_rate_hz
    try:
        N = grid_samples(period, recorded.half_wave)
        check_complete(drivers, place)
        check_repeat(drivers, N, recorded.half_wave, LogReport(str(place), (), known_hz))
    except ElastidError as error:
        keys = [key for key in ("period", "period_samples") if getattr(file, key) is not None]
        key = "period" if recorded.period is not None else "period_samples"
        yield Problem((*path, keys[0]) if keys else (*_RECORDED, key), str(error))


def _check_rate(recorded: RecordedSpec, log: Log) -> Iterator[Problem]:
    """Compare the rate with the time channel of the log, as named by the study, by a typical name, or by the format."""
    if recorded.rate_hz == "unknown":
        return
    rate_hz, where = recorded.known_rate_hz, (*_RECORDED, "rate_hz")
    clocks = {log.time_of(channel) for channel in recorded.channels if channel.file == 1 and not channel.rate_hz} - {""}
    names = [recorded.time] if recorded.time else sorted(clocks) or [name for name in log.shapes() if is_time(name)]
    for name in names:
        stamps = read_stamps(log, name)[0]
        t, _ = without_jumps(stamps)
        steps = np.diff(t)
        if is_clock(-stamps):
            yield Problem(
                (*_RECORDED, "time") if recorded.time else where, f"{name} {RUNS_BACKWARDS}. Sort the rows by it"
            )
        if not len(steps) or not steps.min() > 0 or np.all(steps == 1):  # a counter of samples shows no rate
            continue
        hz = stamp_rate(t), 1 / float(np.median(steps))
        rates = {unit: (hz[0] / s, hz[1] / s) for unit, s in time_units(stamps).items()}
        unit, _ = stamp_size(stamps, rate_hz)
        if recorded.time and rates[unit][0] < 0.7 * rate_hz:
            other_rates = [hz for other, pair in rates.items() if other != unit for hz in pair]
            is_unit_certain = all(_differs(hz, rate_hz) for hz in other_rates)
            advice = "lower rate_hz to that" if is_unit_certain else "correct rate_hz, or give the time in s"
            yield Problem(where, f"{name} has a mean rate of {rates[unit][0]:.5g} Hz in {unit}. {advice}")
        elif not recorded.time and all(_differs(hz, rate_hz) for pair in rates.values() for hz in pair):
            unit = min(rates, key=lambda unit: abs(np.log(rates[unit][0] / rate_hz)))
            yield Problem(where, f"its time {name} (in {unit}) has a mean rate of {rates[unit][0]:.6g} Hz")
        return
    pairs = [(getattr(log.arrays.get(c.channel), "rate_hz", None), c.rate_hz or rate_hz) for c in recorded.channels]
    for hz in [hz for hz, stated_hz in pairs if hz and _differs(hz, stated_hz)][:1]:
        yield Problem(where, f"the log states a rate of {hz:.6g} Hz for its channels")


def _differs(hz: float, rate_hz: float) -> bool:
    # A rate that differs by more is another one; time stamps lose samples and drift.
    return abs(hz / rate_hz - 1) > 0.02
