"""The summary that `elastid check` prints of a friction study: joints, passes, robot time, what will be known."""

from __future__ import annotations

from collections.abc import Iterator

from elastid.app.stages.friction_design import friction_plan
from elastid.experiment.plan.friction import FrictionPlan
from elastid.study import Study


def friction_lines(study: Study) -> Iterator[str]:
    """Plain text below the lines on the robot; StudyError where a simulated study cannot be planned."""
    joints = ", ".join(joint.name for joint in study.friction_joints)
    yield f"friction of joint{'s' if len(study.friction_joints) > 1 else ''} {joints}"
    if study.experiment.recorded is not None:
        files = study.experiment.recorded.files
        yield f"  {len(files)} log file{'s' if len(files) > 1 else ''}; passes are found in them, the rest is regressed"
        stated = [f"{file.path}: {file.speed:.4g}" for file in files if file.speed is not None]
        if stated:
            yield f"  speeds given (SI): {', '.join(stated)}"
    else:
        yield from _planned(friction_plan(study))
    yield ""
    yield (
        f"will {'import the logs' if study.experiment.recorded is not None else 'plan and simulate the motions'}, find "
        "the levels, identify the law, write identified_robot.yml and the report"
    )


def _planned(plan: FrictionPlan) -> Iterator[str]:
    for design in plan.designs:
        unit = design.limits.unit
        low, high = design.limits.window
        speeds = ", ".join(
            f"{speed:.3g}" + (f" ({round(count)} times)" if count > 1 else "")
            for speed, count in zip(design.speed.tolist(), design.passes.tolist(), strict=True)
        )
        yield f"  joint {design.joint}: window {low:.4g} to {high:.4g} {unit}, speeds in {unit}/s: {speeds}"
    kinds = [motion.purpose for motion in plan.motions]
    names = {"passes": "passes there and back", "loops": "logs of loops", "at_rest": "multisines at rest"}
    counted = [f"{kinds.count(kind)} {name}" for kind, name in names.items() if kind in kinds]
    counted += [f"{len(plan.warm_ups)} warm-up{'s' if len(plan.warm_ups) > 1 else ''}"] if plan.warm_ups else []
    yield f"  {', '.join(counted)}, {plan.robot_time_s / 60:.3g} min of the robot's time"
    yield "will be known:"
    yield from (f"  {sentence}" for sentence in plan.known)
    if plan.unknown:
        yield "will not be known:"
        yield from (f"  {sentence}" for sentence in plan.unknown)
