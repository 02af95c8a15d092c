"""The sections `experiment.recorded` and `experiment.responses` against robot and disk: files and channels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from elastid.base.errors import did_you_mean
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ToolSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec, ResponseFileSpec, ResponsesSpec
from elastid.recorded.files.formats import is_log
from elastid.recorded.link_side import channel_refusals
from elastid.study.checks.names import check_place, unknown
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath

# Methods that need no period.
WITHOUT_PERIOD = ("auto", "local_polynomial", "local_rational", "h1", "h2")
_RECORDED: KeyPath = ("experiment", "recorded")


def check_recorded(study: Study, recorded: RecordedSpec, base: Path) -> Iterator[Problem]:
    """Log files exist, no run of the robot is given twice; channels are on the robot; the method suits the period."""
    path = _RECORDED
    yield from check_files(study, recorded.files, path, base)
    yield from check_channels(study, recorded.channels, path)
    yield from _check_method(study, recorded)
    yield from _check_controller(study, recorded)
    for i in range(len(recorded.files)):
        if refused := recorded.repeat_refusal(i):
            yield Problem((*path, "files", i), refused)


def _check_method(study: Study, recorded: RecordedSpec) -> Iterator[Problem]:
    without = [file.path for file in recorded.files if recorded.period_of(file) is None]
    if without and study.estimator.method not in WITHOUT_PERIOD:
        yield Problem(
            ("estimator", "method"),
            f"{study.estimator.method} compares periods, and {without[0]} is recorded without one; give "
            "experiment.recorded.period (a time, or find), or take a method that needs none: "
            f"{', '.join(WITHOUT_PERIOD)}",
        )


def _check_controller(study: Study, recorded: RecordedSpec) -> Iterator[Problem]:
    """Gains for each driven joint; `elastid loops` reads them."""
    if recorded.controller is not None and study.robot is not None:
        key, refused = recorded.controller.refusal(len(study.as_robot().driven))
        if refused:
            yield Problem((*_RECORDED, "controller", key), refused)


def check_responses(study: Study, responses: ResponsesSpec, base: Path) -> Iterator[Problem]:
    """Files of responses exist, one for each configuration; channels are on the robot."""
    path: KeyPath = ("experiment", "responses")
    yield from check_files(study, responses.files, path, base)
    yield from check_channels(study, responses.channels, path)
    claimed: dict[str, str] = {}
    for i, file in enumerate(responses.files):
        if file.configuration in claimed:
            yield Problem(
                (*path, "files", i),
                f"{claimed[file.configuration]} and {file.path} both claim configuration {file.configuration}; one "
                "response of each can be fitted: leave one out, or give it a configuration of its own",
            )
        claimed[file.configuration] = file.path


def check_files(
    study: Study, files: Sequence[FileSpec | ResponseFileSpec], path: KeyPath, base: Path
) -> Iterator[Problem]:
    """Files exist and are of configurations that exist, each of which has one; studies of friction need none."""
    configurations, is_friction = study.experiment.configurations, study.friction is not None
    for i, file in enumerate(files):
        yield from _check_exists(base / file.path, (*path, "files", i, "path"))
        if not file.configuration and not is_friction:
            yield Problem((*path, "files", i, "configuration"), "this key is required", at_key=True)
        elif file.configuration and file.configuration not in configurations:
            yield unknown((*path, "files", i, "configuration"), "configuration", file.configuration, configurations)
    tools = filter(None, (study.tool, study.validation.tool))
    tapped = {file.configuration for tool in tools for file in tool.responses.files}
    for name in configurations:
        if name not in {file.configuration for file in files} | tapped and not is_friction:
            message = f"no file holds configuration {name}; list one in {'.'.join(map(str, path))}.files"
            yield Problem(("experiment", "configurations", name), message, at_key=True)


def _check_exists(place: Path, path: KeyPath) -> Iterator[Problem]:
    if not is_log(place):
        neighbours = _neighbours(place)
        hint = f"; {did_you_mean(place.name, neighbours[:20])}" if neighbours else ""
        yield Problem(path, f"no such file (looked for {place}){hint}", origin=True)


def check_tool(study: Study, base: Path) -> Iterator[Problem]:
    """Files of responses at the tool exist, in configurations of the study, with inputs that its frames take."""
    if study.validation.tool is not None:
        yield from _check_tool(study, study.validation.tool, base, ("validation", "tool"))
    if study.tool is not None:
        yield from _check_tool(study, study.tool, base, ("tool",))


def _check_tool(study: Study, tool: ToolSpec, base: Path, section: KeyPath) -> Iterator[Problem]:
    path: KeyPath = (*section, "responses")
    for i, file in enumerate(tool.responses.files):
        yield from _check_exists(base / file.path, (*path, "files", i, "path"))
        if file.configuration not in study.experiment.configurations:
            names = study.experiment.configurations
            yield unknown((*path, "files", i, "configuration"), "configuration", file.configuration, names)
    robot = study.as_robot()
    inputs = robot.load_locations
    if tool.stiffness and len(tool.stiffness) != len(robot.driven):
        message = f"{len(tool.stiffness)} drives, and robot {robot.name} has {len(robot.driven)}; give one for each"
        yield Problem((*section, "stiffness"), message)
    for i, channel in enumerate(tool.responses.channels):
        place: KeyPath = (*path, "channels", i)
        if channel.role == "u" and channel.at not in inputs:
            yield unknown((*place, "at"), "input", channel.at, inputs)
        elif channel.role == "y":
            yield from check_place((*place, "at"), channel.at, robot)
            if tool.motors == "held" and channel.at.startswith("motor "):
                yield Problem((*place, "at"), f"{channel.at} does not move while the motors are held; leave it out")
        elif channel.quantity != ("force" if channel.at.startswith("force ") else "torque"):
            kind = channel.at.partition(" ")[0]
            message = (
                f"a {kind} acts at {channel.at}, and the channel holds a {channel.quantity}; it must hold a {kind}"
            )
            yield Problem((*place, "quantity"), message)


def _neighbours(place: Path) -> list[str]:
    try:
        return sorted(each.name for each in place.parent.iterdir() if each.is_file())
    except (OSError, ValueError):
        return []


def check_channels(study: Study, channels: Sequence[ChannelSpec], path: KeyPath) -> Iterator[Problem]:
    """Channels are on the robot, in units of their quantity, and one signal each."""
    for i, key, text in channel_refusals(channels, study.places):
        yield Problem((*path, "channels", i, key), text)
