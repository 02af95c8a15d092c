"""`elastid live`: plan an experiment, wait for its logs, check and fit them, and repeat until the goal is reached.

Files in DIR/live: x1.h5, the plan of the first experiment; references/x1-r0-e0.csv, a run of it; logs/x1-r0-e0.csv (or
another log format), its log; x1/, the results of all experiments so far; study.yml and robot.yml, the study of all
logs. All files are written whole or not at all, so that a killed command can be repeated.
"""

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from elastid.app.run import Run, hash_of, run_all, run_stage
from elastid.app.stages.design import movement_of
from elastid.app.stages.fit import TRUSTED
from elastid.base.display import degrees, number
from elastid.base.errors import DataError, FitError, StudyError
from elastid.base.execution import Execution, persistent_workers
from elastid.design.next_experiment import Goal, NextExperiment, PriorEstimate, next_experiment, read_goal
from elastid.design.problem import DesignProblem
from elastid.design.spec import CandidateSpec, DesignSpec, unit_time_s
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.planned_run import contradiction
from elastid.experiment.simulated.hardware import logged_quantity
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.fit.fitted_robot import estimated_robot
from elastid.fit.parameter_selection import choose
from elastid.fit.result import Result
from elastid.friction.robot_friction import coulomb_torques
from elastid.logs.files.formats import is_log
from elastid.robot import Robot, Tolerances
from elastid.robot.tolerances import EXACT
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.files import remove_leftovers, write_text
from elastid.store.measured import read_records, read_responses
from elastid.store.plan import read_plan, write_plan
from elastid.store.results import read_fit
from elastid.store.trajectory import write_references, write_run, write_signals
from elastid.study import Study, load
from elastid.study.loading import study_data
from elastid.study.robots import yaml_text
from elastid.use.draws import draw_robots

POLL_S = 0.5  # interval between checks for a log
# Sections of a study that are independent of its configurations.
STUDY_SECTIONS = ("name", "seed", "model", "estimator", "fit", "gears", "report")
ROBOT, STUDY = "robot.yml", "study.yml"
SPRING_FACTOR = 1.5  # bound on true / nominal stiffness before the first measurement; data sheets: 1.2 to 1.5
N_LIMIT_ROBOTS = 2  # samples with twice the std of the fit that must keep the limits


def live_study(run: Run, goals: Sequence[str], simulate: bool, robot_time: float | None) -> None:
    """Run a live identification; raise FitError with the reason if the goal is not reached.

    robot_time: in s, None for the time of the study's plan.  StudyError for a study without a plan, or a folder of
    another study; DataError for a log that contradicts its plan.
    """
    session = Session.of(run, goals, simulate, robot_time)
    with run.open_folder(), persistent_workers():
        plans, is_reached, end = session.work()
        study = session.write_study(plans)
        run.console.say(f"live: {end}")
    final_run = replace(run, loaded=load(study))
    run_all(final_run)
    ratios = session.goal.reached(read_fit(final_run.path("fit")))
    if not is_reached or max(ratios.values()) > 1:
        raise FitError("live/goal", f"{session.worst(ratios) if is_reached else end}", "the goal is not reached")


@dataclass(frozen=True)
class Session:
    """Live identification of a study.

    run: the study and its result folder.  path: the folder `live`.  outputs: measured locations in the logs.  simulate:
    True if the simulated rig of the study makes the logs.  budget_s: upper limit of the robot time, s.
    """

    run: Run
    goal: Goal
    path: Path
    outputs: tuple[str, ...]
    problem: DesignProblem
    simulate: bool
    budget_s: float

    @classmethod
    def of(cls, run: Run, goals: Sequence[str], simulate: bool, robot_time: float | None = None) -> "Session":
        """Return the session of a study; StudyError for a study without a plan, or a goal without a parameter."""
        study, robot = run.study, run.study.as_robot()
        check_study(study)
        assert study.excitation is not None
        if robot.tolerances is None:  # a simulated rig equals its model
            robot = replace(robot, tolerances=EXACT if simulate else Tolerances(torque_constant=EXACT))
        goal = read_goal(goals, choose(study.fit, robot).free_names)
        outputs = study.experiment.as_simulated().outputs or robot.motor_locations
        candidates = study.design.candidates if study.design else CandidateSpec(given=study.experiment.configurations)
        # Distortion by friction before the first log: in one realisation, relative to |G|.
        distortion = study.design.distortion if study.design else 0.03 * float(coulomb_torques(robot).any())
        design = DesignSpec(count=1, candidates=candidates, parameters=tuple(goal.widths), distortion=distortion)
        experiment = replace(study.experiment, configurations={}, without_payload=())
        problem = DesignProblem(
            robot, study.excitation, experiment, study.seeded_fit, study.estimator.quantity, study.seed, design,
            model=study.model, friction=study.estimator.friction
        )  # fmt: skip
        return cls(run, goal, run.folder / "live", outputs, problem, simulate, robot_time or planned_time_s(run))

    @cached_property
    def stamp(self) -> Stamp:
        """Stamp of all files of the session: values of the study that determine a plan, and the source of the logs."""
        design = self.run.stamps["design"]
        inputs = hash_of([design.inputs, "simulated"]) if self.simulate else design.inputs
        return replace(design, study="", inputs=inputs)

    def work(self) -> tuple[list[Plan], bool, str]:
        """Run experiments until the goal is reached; return the plans, True if it was reached, and the reason."""
        self.path.mkdir(parents=True, exist_ok=True)
        remove_leftovers(self.path)
        plans: list[Plan] = []
        result = None
        while True:
            if result is not None:
                ratios, time_s = self.goal.reached(result), sum(plan.robot_time_s for plan in plans)
                progress = f"{sum(r <= 1 for r in ratios.values())} of {len(ratios)} reached: {self.worst(ratios)}"
                self.run.console.say(f"live: after x{len(plans)}, {time_s:.4g} s: {progress}")
                if result.status not in TRUSTED:
                    return plans, False, _model_error_text(len(plans), result)
                if max(ratios.values()) <= 1:
                    planned_s = planned_time_s(self.run)
                    end = f"goal reached after {len(plans)} experiments and {time_s:.4g} s of robot time, "
                    end += f"{100 * time_s / planned_s:.0f} % of the {planned_s:.4g} s that the study's plan takes"
                    return plans, True, end
            plan = self._next_plan(plans, result)
            if isinstance(plan, str):
                if not plans:
                    raise StudyError("design/goal", plan, "--goal")
                return plans, False, plan
            self._record(plan, len(plans) + 1)
            plans.append(plan)
            result = self._fit(plans, result)

    @contextmanager
    def _execution(self, title: str) -> Iterator[Execution]:
        with self.run.console.progress(f"live: {title}") as progress:
            yield Execution(self.run.jobs, progress)

    def _problem_at(self, result: Result | None) -> DesignProblem:
        if result is None:
            return self.problem
        values = tuple((p.name, result.values[p.name]) for p in result.parameters.of_interest)
        return replace(self.problem, robot=estimated_robot(result), fitted_values=values)

    def _design(self, plans: Sequence[Plan]) -> DesignSpec:
        """Return the section `design` with the distortion of all logs, which longer experiments do not reduce."""
        design = self.problem.design
        assert design is not None
        if not plans:
            return design
        measured = read_responses(self.plan(len(plans)).with_suffix("") / "frf.h5")
        pairs = [(q.stochastic, q.excited.amplitude) for q in (G.quality for G in measured) if q is not None]
        ratios = [np.median((by_distortion / size) ** 2) for by_distortion, size in pairs if by_distortion is not None]
        return replace(design, distortion=math.sqrt(np.mean(ratios)) if ratios else design.distortion)

    def _next_plan(self, plans: Sequence[Plan], result: Result | None) -> Plan | str:
        """Read or design the next plan; return the reason if no further plan leads to the goal."""
        step = len(plans) + 1
        path, problem = self.plan(step), self._problem_at(result)
        if path.is_file():
            stamp = read_stamp(path)
            if stamp is None or stamp.inputs != self.stamp.inputs:
                text = f"{path} was planned for another study, other data or other options"
                advice = "Give another folder with --run, or remove"
                raise StudyError("live/study", f"{text}. {advice} {path.parent} to begin again")
            plan = read_plan(path)
        else:
            design, prior = self._design(plans), PriorEstimate.of(problem)
            if result is not None:
                prior = PriorEstimate(result.parameters, result.x, result.covariance)
            problem = replace(problem, design=design)
            candidates, robots = problem.candidates(design), self._robots(result, step)
            with self._execution(f"plan of x{step}") as execution:
                remaining_s = self.budget_s * (1 + 1e-9) - sum(plan.robot_time_s for plan in plans)
                proposal = next_experiment(
                    problem, candidates, prior, self.goal, robots, f"x{step}", self._seed(step), execution, remaining_s
                )
            if reason := self._refusal(proposal, plans, result):
                return reason
            plan = proposal.plan
            self.run.console.say(
                f"live: x{step} at {degrees(plan.configurations[0].angles.tolist())}, {len(plan.experiments)} runs of "
                f"{plan.periods} periods, {plan.robot_time_s:.4g} s; {proposal.limit_use.closest}"
            )
            write_plan(path, plan, self.stamp, peaks=proposal.limit_use)
        self._write_references(plan, problem)
        return plan

    def _write_references(self, plan: Plan, problem: DesignProblem) -> None:
        """Write the missing references of the runs of a plan."""
        references, carrier = self.path / "references", problem.simulated.carrier
        movement = movement_of(plan, carrier, problem.robot, plan.configurations[0])
        references.mkdir(parents=True, exist_ok=True)
        for run in plan.experiments:
            if (path := references / f"{run.name}.csv").exists():
                continue
            if plan.inject == "torque":
                write_run(path, movement, plan.inputs, plan.sliding, movement.injected(plan.torque(run)))
            else:
                write_references(path, plan, run, problem.simulated, problem.robot)

    def _seed(self, step: int) -> int:
        return int(np.random.SeedSequence([self.problem.seed, step]).generate_state(1)[0])

    def _robots(self, result: Result | None, step: int) -> tuple[Robot, ...]:
        """Return further robots that must keep the limits: samples of the fit, or springs with SPRING_FACTOR."""
        if result is not None:
            twice = replace(result, covariance=4 * result.covariance)
            return draw_robots(twice, N_LIMIT_ROBOTS, self._seed(step)).robots
        springs = {p.name: p.value for p in self.problem.parameters.free if p.name.startswith("k")}
        factors = (1 / SPRING_FACTOR, SPRING_FACTOR) if springs else ()
        ends = [{name: k * factor for name, k in springs.items()} for factor in factors]
        return tuple(map(self.problem.robot.with_parameters, ends))

    def _refusal(self, proposal: NextExperiment, plans: Sequence[Plan], result: Result | None) -> str:
        """Return the reason why no further experiment leads to the goal; empty otherwise."""
        spent_s = sum(plan.robot_time_s for plan in plans)
        if math.isinf(proposal.option.more_s):
            name, ratio = proposal.option.floor
            goal = 100 * self.goal.widths[name]
            text = f"further measurements cannot narrow {name} below {ratio * goal:.2g} % (goal {goal:.3g} %). Reduce"
            return text + " robot.tolerances, log more signals, or fix a parameter that is correlated with it"
        if spent_s + proposal.plan.robot_time_s <= self.budget_s * (1 + 1e-9):
            return ""
        total_s = spent_s + max(proposal.option.more_s, proposal.plan.robot_time_s)
        shortfall = "" if result is None else f"{self.worst(self.goal.reached(result))}; "
        return (
            f"{shortfall}robot time used {spent_s:.4g} s of {self.budget_s:.4g} s, next experiment "
            f"{proposal.plan.robot_time_s:.4g} s, estimated total {total_s:.3g} s. Give --robot-time "
            f"{math.ceil(total_s / 10) * 10}"
        )

    def _record(self, plan: Plan, step: int) -> None:
        """Simulate the runs of a plan, or wait for their logs."""
        logs = self.path / "logs"
        logs.mkdir(exist_ok=True)
        to_record = [run for run in plan.experiments if self.log(run) is None]
        if self.simulate:
            experiment = replace(self.problem.experiment, simulated=self.run.study.experiment.simulated)
            rig = SimulatedRig(self.run.study.as_robot(), experiment, plan, self._seed(step))
            with self._execution(f"x{step}") as execution:
                execution.ordered(partial(write_simulated_log, logs, rig), to_record)
            return
        if to_record:
            self.run.console.say(
                f"live: run {self.path / 'references'}/x{step}-*.csv and write the logs of the complete runs to "
                f"{logs} under the same names; columns: {', '.join(c.channel for c in self.channels)}"
            )
        for run in plan.experiments:
            previous_size = -1  # size in bytes; a log is complete when its size is constant
            while (size := self._size(run)) < 0 or size != previous_size:
                previous_size = size
                time.sleep(POLL_S)

    def _check(self, plan: Plan, records: Path, problem: DesignProblem) -> None:
        """Raise DataError for a record that contradicts its plan."""
        coulomb = coulomb_torques(problem.robot)
        with self._execution(f"rehearsal of {plan.configurations[0].name}") as execution:
            rehearsals = execution.ordered(problem.rig(plan).rehearse, plan.experiments)
        measured = {record.name: record for record in read_records(records, plan.configurations[0].name)}
        for run, rehearsal in zip(plan.experiments, rehearsals, strict=True):
            swings = problem.simulated.carrier is not None
            if reason := contradiction(measured[run.name], plan, rehearsal, coulomb, swings):
                text = reason + ". Replace the log and repeat the command; all earlier logs are kept"
                raise DataError("live/logs", text, f"{self.log(run)} contradicts its plan")

    def _size(self, run: Experiment) -> int:
        """Return the size of a run's log in bytes; -1 without a log."""
        path = self.log(run)
        return -1 if path is None else sum(file.stat().st_size for file in (path, *path.rglob("*")))

    def _fit(self, plans: Sequence[Plan], previous: Result | None) -> Result:
        """Run the stages up to the fit with all logs so far."""
        loaded = load(self.write_study(plans), ("fit.profile=[]", "fit.bootstrap=0"))
        run = replace(self.run, loaded=loaded, folder=self.plan(len(plans)).with_suffix(""))
        for name in ("measure", "estimate", "fit"):
            if name == "estimate" and not run.is_current("fit"):
                self._check(plans[-1], run.path("measure"), self._problem_at(previous))
            if not run.is_current(name):
                run_stage(run, name)
        return read_fit(run.path("fit"))

    def worst(self, ratios: Mapping[str, float]) -> str:
        """Describe the parameter with the largest ratio of interval to goal."""
        name = max(ratios, key=lambda parameter: ratios[parameter])
        goal = 100 * self.goal.widths[name]
        return f"{name} identified to ±{number(ratios[name] * goal, 2)} % (goal {goal:.3g} %)"

    def plan(self, step: int) -> Path:
        """Return the path of the plan of an experiment, counted from 1; its stem is the folder of the results."""
        return self.path / f"x{step}.h5"

    def log(self, run: Experiment) -> Path | None:
        """Return the log of a run, None if it is missing; DataError for several."""
        logs = [path for path in sorted((self.path / "logs").glob(f"{run.name}.*")) if is_log(path)]
        if len(logs) > 1:
            names = ", ".join(path.name for path in logs)
            text = f"{names} are logs of the same experiment. Keep the log that followed its reference"
            raise DataError("live/logs", text, self.path / "logs")
        return logs[0] if logs else None

    @property
    def channels(self) -> tuple[ChannelSpec, ...]:
        """Channels of all logs: injected torque (r), acting torque (u) and motion (y), link side, SI."""
        inputs = self.problem.robot.motor_locations
        torques = [ChannelSpec(role, at, channel=f"{role} {at}") for role in ("r", "u") for at in inputs]
        motions = [ChannelSpec("y", at, channel=f"y {at}", quantity=logged_quantity(at)) for at in self.outputs]
        return (*torques, *motions)

    def _file(self, plan: Plan, run: Experiment) -> FileSpec:
        log, samples = self.log(run), (plan.measured.start, plan.measured.stop)
        assert log is not None
        return FileSpec(f"logs/{log.name}", run.configuration.name, run.realisation, run.experiment, samples=samples)

    def write_study(self, plans: Sequence[Plan]) -> Path:
        """Write study.yml and robot.yml of the measured periods of all logs of some plans; return the study."""
        data, first = study_data(self.run.loaded.path, self.run.loaded.overrides), plans[0]
        files = tuple(self._file(plan, run) for plan in plans for run in plan.experiments)
        period = float(first.period_samples)
        recorded = RecordedSpec(first.rate_hz, self.channels, files, period_samples=period, hold="zero-order")
        configurations = {c.name: tuple(c.angles.tolist()) for plan in plans for c in plan.configurations}
        experiment = ExperimentSpec(configurations, recorded=recorded)
        base = {key: data[key] for key in STUDY_SECTIONS if data.get(key) is not None}
        text = yaml_text({**base, "robot": ROBOT, "experiment": experiment}, ("The logs of a live identification.",))
        write_text(self.path / ROBOT, yaml_text(self.problem.robot))
        write_text(self.path / STUDY, text)
        return self.path / STUDY


def _model_error_text(step: int, result: Result) -> str:
    return (
        f"the logs of x{step} {'contradict the earlier logs, or ' * (step > 1)}have a significant model error: "
        f"{result.message}. Replace them in live/logs, or remove live/x{step}* and live/*/x{step}-*"
    )


def planned_time_s(run: Run) -> float:
    """Return the robot time in s of the plan that the study itself requests."""
    study = run.study
    assert study.excitation is not None
    n_u, experiment, design = len(study.as_robot().driven), study.experiment, study.design
    if design is not None and design.robot_time is not None:
        return float(design.robot_time)
    count = len(experiment.configurations) + (0 if design is None else design.count or 0)
    return count * unit_time_s(study.excitation, experiment, n_u, experiment.periods)


def write_simulated_log(folder: Path, rig: SimulatedRig, run: Experiment) -> None:
    """Write the log of a run on a simulated rig as a robot controller would."""
    inputs, outputs = rig.plan.inputs, rig.outputs
    names = [*(f"r {at}" for at in inputs), *(f"u {at}" for at in inputs), *(f"y {at}" for at in outputs)]
    signals = dict(zip(names, np.hstack(rig.log(run)).T, strict=True))
    write_signals(folder / f"{run.name}.csv", rig.plan.rate_hz, **signals)


def check_study(study: Study) -> None:
    """Raise StudyError for a study without a plan, or with keys that name configurations, which `live` selects."""
    simulated, motors = study.experiment.as_simulated(), study.as_robot().motor_locations
    per_group = [name for name, parameter in study.fit.parameters.items() if parameter.per is not None]
    unsupported = {
        "friction": study.friction,
        "experiment.simulated.outputs": {*motors} - {*(simulated.outputs or motors)},
        "experiment.simulated.carrier": simulated.carrier is not None and simulated.carrier.kind == "offset",
        "fit.robots": study.fit.robots,
        f"fit.parameters.{''.join(per_group[:1])}.per": per_group,
        "fit.weights.factors": any(factor.configurations for factor in study.fit.weights.factors),
        "experiment.without_payload": study.experiment.without_payload,
    }
    text = "live plans for elasticity, chooses the configurations of one robot itself, without a carrier of constant"
    text += " velocity, and reads the position of every motor; leave this key out"
    for place in (place for place, is_present in unsupported.items() if is_present):
        raise StudyError("live/study", text, place)
    if study.excitation is None:
        raise StudyError("study/stage", "this section is needed to plan an experiment", "excitation")
