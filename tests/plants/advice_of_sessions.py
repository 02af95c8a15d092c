"""Cases of advice in messages of live sessions."""

from __future__ import annotations

from pathlib import Path

from elastid.app.console import Console
from elastid.app.live.session import Asked, Session
from elastid.app.run import Run
from elastid.recorded.files.formats import naming
from elastid.study import load
from plants.advice import Desk, case, refusal, rendered
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
