"""The command `live`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from elastid.app.options import POSITIVE, run_of, stage_options, study_argument


@click.command()
@study_argument
@click.option("--goal", "goals", multiple=True, required=True, metavar="TEXT",
    help='Half width of 95 % intervals, such as "k_*: 1 %"; again for more.')  # fmt: skip
@click.option("--simulate", is_flag=True, help="The simulated rig of the study takes the place of the robot.")
@click.option("--robot-time", "robot_time", type=POSITIVE, metavar="S",
    help="That it may take (default: that of the study's own plan).")  # fmt: skip
@stage_options
def live(study: Path, goals: tuple[str, ...], simulate: bool, robot_time: float | None, **options: Any) -> None:
    """Measure experiment by experiment until the parameters are known as well as the goal says.

    Each experiment, its posture and its length, is the one that brings most towards the goal in a second of the
    robot's time, given all logs so far, and keeps the limits of the robot on every robot that they allow. It is written
    into DIR/live/references, a file for each run; its logs are awaited in DIR/live/logs under the same names. A log
    that contradicts its plan ends the command. It can be ended at any time; the same command goes on from there. At
    the end DIR holds the results as `elastid run` leaves them, of the study DIR/live/study.yml. Default of --run:
    runs/<name of the study>-live, with --simulate runs/<name of the study>-live-simulated.
    """
    asked = run_of(study, options)
    from elastid.app.live.session import Asked, live_study

    # Simulated logs never lie where those of the robot are awaited.
    folder = options["folder"] or Path("runs") / f"{asked.study.name}-live{'-simulated' * simulate}"
    live_study(asked, folder, Asked(goals, simulate, robot_time))
