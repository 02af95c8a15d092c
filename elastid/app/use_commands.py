"""Commands that put an identified robot to work: map, tune, loops."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from elastid.app.options import POSITIVE, RATE, Finite, run_of, stage_options, study_argument


@click.command(name="map")
@study_argument
@click.option("--frame", metavar="NAME", help="Frame of the robot (default: tool, else the last one).")
@click.option("--path", type=click.Path(path_type=Path), metavar="FILE", help="CSV of joint angles, or of poses.")
@click.option("--grid", is_flag=False, flag_value=12, type=click.IntRange(2, 60), metavar="[N]",
    help="A grid over the workspace, N points along its longest side (12 if not given).")  # fmt: skip
@click.option("--random", type=click.IntRange(1, 100_000), metavar="N",
    help="Random postures (1000 if nothing is given).")  # fmt: skip
@click.option("--load", type=float, nargs=3, default=(0.0, 0.0, -100.0), show_default=True, metavar="X Y Z",
    help="Force at the frame in N, axes of the base.")  # fmt: skip
@click.option("--cutting", type=float, default=700e6, show_default=True, metavar="N/M^2", help="Cutting coefficient.")
@click.option("--normal", type=float, nargs=3, metavar="X Y Z", help="Normal of the cut (default: the worst one).")
@click.option("--cutting-force", "force", type=float, nargs=3, metavar="X Y Z", help="Its force (default: --normal).")
@click.option("--band", "band_hz", type=float, nargs=2, metavar="LOW HIGH", help="Lines in Hz (default: the modes).")
@stage_options
def map_command(study: Path, **options: Any) -> None:
    """Map the fitted robot over its workspace: map.html, map.csv and map.h5.

    At every posture of a path, a grid or at random, with the motors held and with intervals: static compliance and its
    softest direction, natural frequencies, largest dynamic compliance, limiting depth of cut without chatter,
    deflection under a load, and the spring that limits it. A path is a CSV file with a column for each driven joint
    (rad, or `1 deg`), or with poses x, y, z in m and rx, ry, rz in rad.
    """
    asked = run_of(study, options)
    from elastid.app.use_fit import map_study

    map_study(asked, **options)


@click.command()
@study_argument
@click.option("--path", type=click.Path(path_type=Path), required=True, metavar="FILE",
    help="CSV of joint angles or poses, with times in a column t, or without.")  # fmt: skip
@click.option("--time", "duration", type=Finite(0, 600, min_open=True), metavar="S", help="Duration in s.")
@click.option("--fastest", is_flag=True, help="The shortest time in which the error is kept.")
@click.option("--error", "error_mm", type=POSITIVE, default=1.0, show_default=True,
    metavar="MM", help="That the tool may have, as planned.")  # fmt: skip
@click.option("--frame", metavar="NAME", help="Frame that follows the path (default: tool, else the last one).")
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ",
    help="Of the references (default: that of the study, else 500).")  # fmt: skip
@click.option("--bandwidth", "bandwidth_hz", type=POSITIVE, default=4.0,
    show_default=True, metavar="HZ", help="Of the drives' position loops, in the simulation.")  # fmt: skip
@click.option("--draws", type=click.IntRange(0, 200), default=20, show_default=True, metavar="N",
    help="Robots drawn from the fit, on which limits hold, too.")  # fmt: skip
@stage_options
def tune(study: Path, **options: Any) -> None:
    """Command a move so that the tool follows its path: tune.csv, tune.h5, tune.html and files for controllers.

    Motor references with velocities and torque feedforward by optimal control of the fitted elastic model with its
    friction, within the limits of the robot's joints, on robots drawn from the fit, too. A path is a CSV file with a
    column for each driven joint (rad, or `1 deg`) or with poses x, y, z in m and rx, ry, rz in rad, and a column t in
    s. Without t it is a way that starts and ends at rest, such as two rows, and --time or --fastest says how long it
    takes; with t these stretch it.
    """
    asked = run_of(study, options)
    from elastid.app.use_fit import tune_study

    tune_study(asked, **options)


@click.command()
@study_argument
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ", help="Of the controller (default: the study's).")
@click.option("--delay", type=click.IntRange(min=0), metavar="N",
    help="Samples from reading to torque (default: the study's, else 0).")  # fmt: skip
@click.option("--draws", type=click.IntRange(0, 5000), default=200, show_default=True, metavar="N",
    help="Robots drawn from the fit, of which 95 % keep the limit.")  # fmt: skip
@stage_options
def loops(study: Path, **options: Any) -> None:
    """Sensitivity of the joint controllers, and gains for the fitted robot: loops.html, loops.csv, a section to paste.

    Of today's controller, as the study states it, sensitivity peak and bandwidths; and gains of position and velocity,
    notches and low passes with the largest bandwidth whose sensitivity stays below 6 dB in all postures of the study,
    and on 95 % of the robots drawn from the fit. The gains are written as the section `controller` of a study, too.
    """
    asked = run_of(study, options)
    from elastid.app.use_fit import loops_study

    loops_study(asked, **options)
