"""Cases of advice in messages of live sessions."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.app.console import Console
from elastid.app.live.session import Asked, Session
from elastid.app.run import Run
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.movement import reference
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.plant import feed_forward_of, model_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.recorded.files.formats import naming
from elastid.recorded.planned_run import PlannedRun, contradiction
from elastid.study import load
from plants.advice import Desk, case, refusal, rendered
from plants.limited_arm import arm, experiment
from plants.live_arm import GOAL, STUDY

FINE = "k_*: 0.06 %"


def session(desk: Desk, folder: str, goal: str, robot_time: float, seed: int = 1) -> tuple[bool, str]:
    """Whether the goal was reached, and how it ended."""
    study = load(desk.write(study=STUDY), [f"seed={seed}"])
    run = Run(study, desk.folder / folder, 1, Console(-2))
    return Session.of(run, Asked((goal,), True, robot_time)).work()[1:]


@case("app/live/session.py", "--robot-time ‹›", slow=True)
def robot_time_that_is_used(desk: Desk) -> None:
    reached, said = session(desk, "run", FINE, 16.0)
    assert not reached
    needed = float(rendered("--robot-time ‹›", said).split()[1])
    assert needed > 16.0
    assert session(desk, "run", FINE, needed)[0]


@case("app/live/session.py", "--run", slow=True)
def folder_of_another_study(desk: Desk) -> None:
    session(desk, "run", GOAL, 16.0)
    assert rendered("--run", refusal(lambda: session(desk, "run", GOAL, 16.0, seed=2)))
    assert refusal(lambda: session(desk, "another", GOAL, 16.0, seed=2)) == ""


@case("app/live/folder.py", "elastid inspect ‹›")
def log_that_cannot_be_used(desk: Desk) -> None:
    """As of every log that is read."""
    path = Path(desk.folder) / "x1-r0-e0.csv"
    path.write_text("t,u\n0,1\n1,2\n2,1\n", encoding="utf-8")

    def attempt() -> None:
        with naming(path, f"look at them with `elastid inspect {path}`"):
            raise ZeroDivisionError

    assert desk.elastid(*rendered("elastid inspect ‹›", refusal(attempt)).split()[1:]) == ""


@case("recorded/planned_run.py", "lower excitation.torque_rms")
def drive_that_clips(desk: Desk) -> None:
    """It gives 150 N m and no more, of which half the excitation needs less."""

    def said(torque_rms: float) -> str:
        robot, rest = arm(), experiment(None, ramp=0.25, hold=0.1)
        excitation = MultisineSpec(rate_hz=500.0, period=1.0, band_hz=(2.0, 60.0), torque_rms=(torque_rms, 20.0))
        plan = make_plan(excitation, rest, robot, 3)
        rig, run = SimulatedRig(robot, rest, plan, 3), plan.experiments[0]
        given = reference(plan, None, feed_forward_of(model_of(robot)), run.configuration)
        r, u, y = rig.log(run)
        return contradiction(PlannedRun(plan, run, given, rig.rehearse(run), robot, False), r, np.clip(u, -150, 150), y)

    assert rendered("lower excitation.torque_rms", said(80.0))
    assert said(40.0) == ""
