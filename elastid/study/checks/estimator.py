"""The section `estimator` against the experiment: friction that a study asks for can be found in its records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from elastid.experiment.specs.recorded import RecordedSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.study.messages import Problem
from elastid.study.sections import Study


def check_estimator(study: Study) -> Iterator[Problem]:
    """Records of periodic experiments with the motion of the motors, and more than one response explains."""
    wanted, experiment = study.estimator.friction, study.experiment
    if wanted not in ("coulomb", "curve"):  # `auto` leaves friction alone where it cannot be found
        return
    if experiment.responses is not None:
        refusal = (
            "responses from elsewhere have no records that show friction; take it out where they are estimated (list "
            "their logs under experiment.recorded), or take none"
        )
    elif experiment.recorded is not None:
        refusal = _refusal_of_logs(experiment.recorded)
    else:
        refusal = _refusal_of_rig(study, experiment.as_simulated())
    if refusal:
        yield Problem(("estimator", "friction"), f"{wanted}: {refusal}")


def _refusal_of_rig(study: Study, simulated: SimulatedSpec) -> str:
    """Why friction cannot be found in records of the simulated rig; empty where it can."""
    motors, experiment, excitation = study.places.motor_locations, study.experiment, study.excitation
    missing = [motor for motor in motors if simulated.outputs and motor not in simulated.outputs]
    if missing:
        return _refusal_of_outputs(missing, "add to experiment.simulated.outputs")
    count = experiment.realisations * experiment.runs(len(motors))
    if count > len(motors) or excitation is None or excitation.grid != "full":
        return ""
    return (
        f"{count} experiments on a full grid agree with one response of {len(motors)} inputs whatever friction is; "
        "give experiment.realisations: 2 or more, excitation.grid: odd, or take none"
    )


def _refusal_of_logs(recorded: RecordedSpec) -> str:
    """Why friction cannot be found in logs; empty where it can, as far as a study shows."""
    without = [file.path for file in recorded.files if recorded.period_of(file) is None]
    if without:
        return (
            f"friction is found from differences between periodic experiments, and {without[0]} is recorded without a "
            "period; give experiment.recorded.period (a time, or find), or take none"
        )
    inputs = dict.fromkeys(channel.at for channel in recorded.channels if channel.role == "u")
    outputs = {channel.at for channel in recorded.channels if channel.role == "y"}
    missing = [place for place in inputs if place not in outputs]
    if missing:
        return _refusal_of_outputs(missing, "give a channel of role y there in experiment.recorded.channels")
    return ""


def _refusal_of_outputs(missing: Sequence[str], how: str) -> str:
    return (
        f"friction is a function of the motors' own motion, and {', '.join(missing)} "
        f"{'is' if len(missing) == 1 else 'are'} not among the outputs; {how}, or take none"
    )
