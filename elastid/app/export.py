"""`elastid export`: results of a run -> export/<target>/ in its folder, for another program."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

from elastid.app.commanded_robot import command_delay, robot_of_friction, with_armatures
from elastid.app.identified_robot import robot_of_fit, with_identified_effects
from elastid.app.run import Run
from elastid.app.stages.fit import gears_of, warn_of_distrust
from elastid.app.target_table import tags, targets
from elastid.base.codes import new_code
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.escape import file_name
from elastid.base.files import clear_folder
from elastid.fit.fitted_robot import FittedRobot, models_by_group, robots_by_group
from elastid.fit.result import Result
from elastid.friction_study.result import FrictionResult
from elastid.logs.responses.universal_files import geometry_of_files
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.gear_result import GearResult, with_gears
from elastid.nonlinear.robot_with_gears import with_effects, with_linear_springs, with_terms_of
from elastid.robot import Robot
from elastid.simulation.controller import loop_of
from elastid.store.friction_study import read_filter, read_friction_result
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit
from elastid.study import Study
from elastid.targets.actuators import actuators_of, fit_intervals, friction_intervals, with_total_inertias
from elastid.targets.numbers import interval_lines
from elastid.targets.target import VALUES
from elastid.use.draws import draw_robots

Values: TypeAlias = Mapping[str, Any]  # by label of the robot or group of configurations; "" for all


def export(run: Run, tag: str, count: int = 1000) -> tuple[Path, ...]:
    """Write export/<tag>/ with a folder for each robot or group that has separate parameters; return the files.

    count: number of posterior samples.  Raises StudyError for an unknown target or without current results.
    """
    study = run.study
    results = (_Friction if study.friction else _Responses if study.robot is None else _Fit)(run, count)
    available = VALUES.keys() & {*dir(results)}
    rows = [row for name in tags() for row in targets(name) if {*row.arguments} <= available]
    target = next((row for row in rows if row.tag == tag), None)
    if target is None:
        names = new_code(tag) or did_you_mean(tag, sorted({row.tag for row in rows}))
        code = "study/stage" if tag in tags() else "export/target"
        raise StudyError(code, f"study {study.name} of kind {study.kind}: {names}", f"--to {tag}")
    for stage in dict.fromkeys(stage for name in target.arguments for stage in STAGES.get(name, results.stages)):
        run.require_stage(stage)
        run.require_result(stage)
    folder = clear_folder(run.folder, "export", tag)
    values: dict[str, Values] = {name: getattr(results, name)() for name in target.arguments}
    gears = None if target.has_gear_effects or not isinstance(results, _Fit) else results.gears
    if gears is not None and gears.effects:
        omitted = "some effects of the gears are omitted (k and d are as estimated with them); robot and fmu have all"
        run.console.say(f"export: {tag}: {omitted}")
    paths: list[Path] = []
    for label in max(values.values(), key=len):
        arguments = {name: value.get(label, value.get("")) for name, value in values.items()}
        paths += target.write(folder / file_name(label), **arguments)
    for path in paths:
        run.console.say(f"export: {path}")
    return tuple(paths)


# Stages on which a value depends, if they differ from `stages` of its class.
STAGES: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(("responses", "modes", "geometry"), ("estimate",)),
    "draws": ("fit",), "observers": ("follow",), "name": (), "warn": ()
}  # fmt: skip


@dataclass(frozen=True)
class _Results:
    """Values for targets, by methods with the names of `VALUES`.  count: number of posterior samples."""

    run: Run
    count: int
    stages: ClassVar[tuple[str, ...]] = ()

    def name(self) -> Values:
        return {"": self.run.study.name}

    def warn(self) -> Values:
        return {"": self.run.console.warn}


class _Responses(_Results):
    """Measured responses and their modes."""

    def responses(self) -> Values:
        return {"": read_responses(self.run.path("estimate"))}

    def modes(self) -> Values:
        from elastid.modal.estimate import estimate_all_modes  # SciPy's linear algebra

        return {"": estimate_all_modes(self.responses()[""], self.run.study.modal)}

    def geometry(self) -> Values:
        study = self.run.study
        return {"": study.modal.geometry or geometry_of_files(study.experiment, self.run.loaded.path.parent)}


class _Fit(_Responses):
    """Identified model of each robot or group of configurations with separate parameters, by label."""

    stages = ("estimate", "fit")

    def modes(self) -> Values:
        return {"": ()}

    def geometry(self) -> Values:
        return {"": None}

    @cached_property
    def gears(self) -> GearResult | None:
        return gears_of(self.run)

    @cached_property
    def result(self) -> Result:
        result = with_gears(read_fit(self.run.path("fit")), self.gears)
        warn_of_distrust(self.run, "export", result)
        return result

    @cached_property
    def friction(self) -> CompensatedFriction | None:
        return read_friction(self.run.path("estimate"))

    def _models(self, robot: Robot, result: Result) -> dict[str, FittedRobot]:
        study, responses = self.run.study, read_responses(self.run.path("estimate"))
        models = models_by_group(result, robot, responses, study.model, study.name)
        if any(models):
            groups = (f"{label} ({', '.join(G.configuration.name for G in m.measured)})" for label, m in models.items())
            self.run.console.say(f"export: one model for each group with its own parameters: {', '.join(groups)}")
        return models

    @cached_property
    def linear(self) -> dict[str, FittedRobot]:
        """Models without gear effects."""
        return self._models(self.run.study.as_robot(), self.result)

    def model(self) -> Values:
        plain = self.geared()[""]
        return self.linear if plain is None else self._models(plain, with_terms_of(self.result, plain))

    def linear_model(self) -> Values:
        plain = self.geared()[""]
        straight = None if plain is None else with_linear_springs(plain)
        return self.linear if straight is None else self._models(straight, with_terms_of(self.result, straight))

    def geared(self) -> Values:
        return {"": None if self.gears is None else with_effects(self.run.study.as_robot(), self.gears)}

    def title(self) -> Values:
        return {label: m.name for label, m in self.linear.items()}

    def known(self) -> Values:
        return {label: interval_lines(m) for label, m in self.linear.items()}

    def robot(self) -> Values:
        return {label: with_identified_effects(m.robot, self.friction, self.gears) for label, m in self.linear.items()}

    def robot_file(self) -> Values:
        contents = {label: (m.name, m.robot, self.friction, interval_lines(m)) for label, m in self.linear.items()}
        return {label: robot_of_fit(*values, self.gears) for label, values in contents.items()}

    def actuators(self) -> Values:
        robots, gains = self.robot(), _gains(self.run.study)
        contents = {k: (m.name, robots[k], fit_intervals(m, self.friction)) for k, m in self.linear.items()}
        return {label: actuators_of(*values, gains) for label, values in contents.items()}

    def draws(self) -> Values:
        run, result, samples = self.run, self.result, {}
        if self.gears is not None and result.robot is not None:
            robot = with_effects(result.robot, self.gears)
            result = with_terms_of(replace(result, robot=robot), robot)
            run.console.say("export: all samples have the same effects of the gears")
        for label, (_, members) in robots_by_group(result, run.study.as_robot(), result.configurations).items():
            samples[label] = draw_robots(result, self.count, run.study.seed, members[0])
            if fixed := samples[label].fixed:
                run.console.warn(f"export: {', '.join(fixed)} not identifiable: the same in all samples")
        return samples


class _Friction(_Results):
    """Identified friction, and the robot with this friction."""

    stages = ("friction",)

    @cached_property
    def result(self) -> FrictionResult:
        return read_friction_result(self.run.path("friction"))

    @cached_property
    def law(self) -> Robot:
        return with_armatures(self.run.study.as_robot(), self.result)

    title = _Results.name

    def known(self) -> Values:
        return {"": ()}

    def friction_result(self) -> Values:
        return {"": self.result}

    def robot(self) -> Values:
        return {"": self.law}

    def robot_file(self) -> Values:
        return {"": robot_of_friction(self.run.study.name, self.run.study.as_robot(), self.result)}

    def actuators(self) -> Values:
        study, delay_s, intervals = self.run.study, command_delay(self.result), friction_intervals(self.result)
        numbers = actuators_of(study.name, self.law, intervals, _gains(study), delay_s)
        return {"": with_total_inertias(numbers, self.result)}

    def observers(self) -> Values:
        return {"": {row.joint: row for row in read_filter(self.run.path("follow"))}}


def _gains(study: Study) -> tuple[tuple[float, float], ...]:
    """Return kp and kd of each joint (link side) of the study's controller; empty without stated gains."""
    simulated, recorded = study.experiment.simulated, study.experiment.recorded
    controller = recorded.controller if recorded else simulated.controller.gains if simulated else None
    if controller is None:
        return ()
    loop = loop_of(controller, len(study.as_robot().driven))
    return tuple(zip(loop.kp.tolist(), loop.kd.tolist(), strict=True))
