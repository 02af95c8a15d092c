"""The command line: each word calls one function. Heavy imports stay inside the bodies.

Exit codes: 0 done; 1 the data or the fit are at fault; 2 usage or study; 3 done and written, but a misfit, not to be
believed as it stands; 130 interrupted.
"""

import os
import shlex
import sys
from codecs import register_error
from collections.abc import Sequence
from dataclasses import replace
from io import StringIO, TextIOWrapper
from pathlib import Path
from typing import Any

import click

from elastid import __version__
from elastid.app.options import (
    POSITIVE,
    RATE,
    insisting,
    libraries_off_terminal,
    options_of,
    run_of,
    stage_options,
    study_argument,
)
from elastid.app.stage_table import NAMES
from elastid.base.codes import renamed
from elastid.base.errors import ElastidError
from elastid.base.escape import printable


def main() -> None:
    """The program `elastid`."""
    # A program that was started without them (`>&-`) has None here, which nothing below expects.
    sys.stdout = sys.stdout or StringIO()
    sys.stderr = sys.stderr or StringIO()
    register_error("elastid", _in_ascii)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="elastid")
    os.environ["MPLBACKEND"] = "agg"  # that of a notebook, in whose cells the program runs, may not be there
    sys.exit(run_command(sys.argv[1:]))


def _in_ascii(error: Any) -> tuple[str, int]:
    """The nearest letters of a terminal that has no others, for the first that it lacks (a handler of codecs)."""
    return _ASCII.get(error.object[error.start], "?"), error.start + 1


_ASCII = {"±": "+-", "–": "-", "─": "-", "°": "deg", "µ": "u", "²": "^2", "·": "*", "…": "...", "Δ": "D"}


def run_command(arguments: Sequence[str]) -> int:
    """A command, and its exit code however it ends (`elastid.app.cli`)."""
    try:
        with libraries_off_terminal(), insisting() as pressed:
            cli.main(list(arguments), prog_name="elastid", standalone_mode=False)
    except (KeyboardInterrupt, click.Abort):
        return interrupted(arguments)
    except Exception as error:
        return interrupted(arguments) if pressed.is_set() else explained(error, arguments)
    return 0


# The keys of app.export.TARGETS and RESPONSE_TARGETS, which would bring CasADi and SciPy to every command.
_TARGETS = [
    *("robot", "control", "matlab", "mujoco", "fmu", "urdf", "casadi", "c", "csv", "uff", "samples", "observer"),
    "compensation",
]


# Groups of commands, in the order of the help.
_GROUPS = {
    "Start": ("demo", "new", "check", "run"),
    "Look": ("inspect", "explain", "compare", "predict"),
    "Use": ("map", "tune", "loops", "export"),
    "Campaign": ("live", "fleet"),
}


class InGroups(click.Group):
    """A group whose help lists the commands by what they are for, each with its first sentence in full."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order of the help."""
        return [name for names in _GROUPS.values() for name in names]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Names and first sentences, wrapped and not cut."""
        for group, names in _GROUPS.items():
            helps = [(name, (self.commands[name].help or "").split("\n\n")[0]) for name in names]
            with formatter.section(group):
                formatter.write_dl([(name, " ".join(text.split())) for name, text in helps])

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """The command; a stage that is taken for one is named as an argument of `run`."""
        if name in NAMES:
            ctx.fail(f"{name} is a stage: elastid run STUDY {name}")
        return super().get_command(ctx, name)


@click.group(cls=InGroups, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="elastid")
def cli() -> None:
    """Identify the elasticity of industrial robots from frequency responses, with honest intervals."""
    one_blas_thread()  # before any command loads NumPy: several threads add in an order of their own


@cli.command()
@options_of("run", "jobs", "verbose", "quiet")
def demo(**options: Any) -> None:
    """Identify a simulated three-axis arm, from excitation to report."""
    from elastid.app import scaffold

    folder = options["folder"] or Path("runs") / "demo"
    run = run_of(scaffold.demo(folder), {**options, "folder": folder})
    from elastid.app.run import run_all

    run_all(run)


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--template", default="serial", show_default=True,
    type=click.Choice(["serial", "parallel-linkage", "recorded", "ros2", "responses", "frf", "friction"]),
)  # fmt: skip
@click.option(
    "--from", "logs", multiple=True, type=click.Path(path_type=Path),
    help="Guess it from these logs, a URDF or MJCF file, or both.",
)  # fmt: skip
@click.argument("more", type=click.Path(path_type=Path), nargs=-1, metavar="")
def new(folder: Path, template: str, logs: tuple[Path, ...], more: tuple[Path, ...]) -> None:
    """Write a study to edit, its robot and the schema for editors into a new folder.

    Templates recorded and frf (responses and their modes, without a robot) come with a small simulated log in logs/.
    """
    from elastid.app import scaffold

    study = scaffold.new_from_logs(folder, logs, more) if logs or more else scaffold.new(folder, template)
    click.echo(f"{printable(str(study))} is yours to edit; then `elastid check {study}` and `elastid run {study}`")


@cli.command()
@study_argument
@options_of("set")
def check(study: Path, overrides: tuple[str, ...]) -> None:
    """Show all errors of a study with file, line and column, its logs opened; else a summary of it and its stages."""
    from elastid.app.overview import overview
    from elastid.study import load_with_logs

    click.echo(printable(overview(load_with_logs(study, overrides).study)))


@cli.command()
@study_argument
@click.argument("stages", nargs=-1, type=click.Choice(NAMES), metavar="[STAGE]...")
@options_of("png")
@stage_options
def run(study: Path, stages: tuple[str, ...], png: bool = False, **options: Any) -> None:
    """Run all stages in order, except those whose inputs have not changed; or the stages that are named, in any case.

    \b
    design    configurations, excitation, predicted intervals: plan.h5, references/*.csv
    measure   the simulated experiments, or the recorded logs: records.h5
    estimate  the frequency responses with their covariance: frf.h5
    fit       the elastic parameters: fit.h5, summary.json
    gears     (gears: {}) friction, stiffening, hysteresis and errors of the gears: gears.h5
    validate  the fit on left-out configurations, and its residuals: validation.h5
    constant_velocity  (friction) friction torque by speed, load and temperature: constant_velocity.h5
    friction  (friction) its law: friction.h5, summary.json
    follow    (filter: {}) the friction over the motions, by a Kalman filter: filter.h5
    report    the page and, where asked for, figures: report.html, figures/
    """
    asked = run_of(study, options | {"overrides": (*options["overrides"], *["report.formats=[png]"] * png)})
    from elastid.app.run import run_all

    run_all(asked, stages)


@cli.command()
@click.argument("studies", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="STUDY [STUDY ...]")
@click.option("--search", is_flag=True, help="Search for the elastic gears, joints and rods.")
@stage_options
def compare(studies: tuple[Path, ...], search: bool, **options: Any) -> None:
    """Rank models by their prediction error on left-out configurations of the first study: compare.json.

    The models are those of the study's section `compare` (by default the robot without motor coupling, and without each
    elastic joint that is not driven), and those of further studies. With --search the models come from a stepwise
    search: it starts from elastic gears of the driven joints alone and frees or stiffens one gear, elastic joint or rod
    at a time; a free one must lower the left-out error by more than its standard error, and the criterion too.
    """
    if search and len(studies) > 1:
        raise click.UsageError(f"--search takes one study, and there are {len(studies)}; leave it out, or the others")
    asked = run_of(studies[0], options)
    from elastid.app import compare as comparing
    from elastid.study import load

    if search:
        comparing.search_elasticity(asked)
        return
    comparing.compare(asked, [load(study) for study in studies[1:]])


@cli.command()
@study_argument
@options_of("with", "log")
@stage_options
def predict(study: Path, source: Path, logs: tuple[Path, ...], **options: Any) -> None:
    """Judge the numbers that another study has identified on logs: prediction.json and prediction.png.

    Of friction, with the rigid body, or of elasticity: the torque that each part of the model explains and leaves, by
    axis and octave, and the motion of the robot simulated along the logs. The logs are those of STUDY, or those given.
    """
    from elastid.app import use_fit

    use_fit.predict(run_of(study, use_fit.on_logs(study, logs, options)), source)


@cli.command(name="map")
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


@cli.command()
@study_argument
@click.option("--path", type=click.Path(path_type=Path), required=True, metavar="FILE",
    help="CSV of joint angles or poses, with times in a column t, or without.")  # fmt: skip
@click.option("--time", "duration", type=POSITIVE, metavar="S", help="Duration in s.")
@click.option("--fastest", is_flag=True, help="The shortest time in which the error is kept.")
@click.option("--error", "error_mm", type=POSITIVE, default=1.0, show_default=True,
    metavar="MM", help="That the tool may have, as planned.")  # fmt: skip
@click.option("--frame", metavar="NAME", help="Frame that follows the path (default: tool, else the last one).")
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ",
    help="Of the references (default: that of the study, else 500).")  # fmt: skip
@click.option("--bandwidth", "bandwidth_hz", type=POSITIVE, default=4.0,
    show_default=True, metavar="HZ", help="Of the drives' position loops, in the simulation.")  # fmt: skip
@click.option("--samples", type=click.IntRange(0, 200), default=20, show_default=True, metavar="N",
    help="Posterior samples of the robot on which the limits must hold.")  # fmt: skip
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


@cli.command()
@study_argument
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ", help="Of the controller (default: the study's).")
@click.option("--delay", type=click.IntRange(0, 20), metavar="N",
    help="Samples from reading to torque (default: the study's, else 0).")  # fmt: skip
@click.option("--samples", type=click.IntRange(0, 5000), default=200, show_default=True, metavar="N",
    help="Posterior samples of the robot, of which 95 % keep the limit.")  # fmt: skip
@stage_options
def loops(study: Path, **options: Any) -> None:
    """Sensitivity of the joint controllers, and gains for the fitted robot: loops.html, a section to paste.

    Of today's controller, as the study states it, sensitivity peak and bandwidths; and gains of position and velocity,
    notches and low passes with the largest bandwidth whose sensitivity stays below 6 dB in all postures of the study,
    and on 95 % of the robots drawn from the fit. The gains are written as the section `controller` of a study, too.
    """
    asked = run_of(study, options)
    from elastid.app.use_fit import loops_study

    loops_study(asked, **options)


@cli.command()
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
    given, asked = options["folder"], run_of(study, options)
    from elastid.app.live import live_study

    # Simulated logs never lie where those of the robot are awaited.
    folder = given or Path("runs") / f"{asked.study.name}-live{'-simulated' * simulate}"
    live_study(replace(asked, folder=folder), goals, simulate, robot_time)


@cli.command()
@study_argument
@click.option("--to", "target", type=click.Choice(_TARGETS), required=True, help="The tool that will read it.")
@click.option("--count", type=click.IntRange(1, 100_000), default=1000, show_default=True, help="Of --to samples.")
@stage_options
def export(study: Path, target: str, count: int, **options: Any) -> None:
    """Write the identified model for another tool into export/<target>/ of the run folder, with its intervals.

    The target robot is the robot's file with the identified numbers, of a study of elasticity or of friction; samples
    are --count such robots from the posterior, as robot files, MJCF and a table; compensation is the friction of the
    motors over velocity in C; observer is the filter of a friction study in C; all others take the fitted model of a
    study of elasticity. A study without a robot exports its measured responses to control, matlab, csv or uff; uff
    takes the responses of any study.
    """
    asked = run_of(study, options)
    from elastid.app.export import export as export_model

    export_model(asked, target, count)


@cli.command()
@click.argument("fleet", type=click.Path(path_type=Path))
@options_of("run", "jobs", "dask", "verbose", "quiet")
def fleet(fleet: Path, **options: Any) -> None:
    """Run one study over many robots and dates, and report which parameters differ and which drift.

    FLEET is a YAML file that names the study and its members: a list, or a table (CSV with the columns robot and date
    and keys of the study). It leaves fleet.parquet, a row for each parameter of each member, and
    the page fleet.html. Members that are finished are kept, and a worker that dies costs the member that it was at.
    With --dask the workers of a cluster, which must see the same files, run the members. The exit code is 1 where
    members failed, and 3 where some are misfits.
    """
    from elastid.app.console import Console
    from elastid.app.fleet import run_fleet
    from elastid.app.run import all_cores
    from elastid.base.execution import on_dask
    from elastid.study.fleet import load_fleet

    loaded = load_fleet(fleet)
    folder = options["folder"] or Path("runs") / loaded.name
    console = Console(options["verbose"] - options["quiet"])
    with on_dask(options["dask"]):
        run_fleet(loaded, folder, options["jobs"] or all_cores(), console)


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
def inspect(file: Path) -> None:
    """Show the content of a log or a result: names, shapes, units, rates, values."""
    from elastid.app.inspection import described

    click.echo(printable(described(file)))


@cli.command()
@click.argument("key", required=False)
@click.argument("study", type=click.Path(path_type=Path), required=False)
@options_of("run")
def explain(key: str | None, study: Path | None, folder: Path | None) -> None:
    """Explain a key of a study, a code of an error or note, or a parameter of the robot; without KEY, list all keys.

    \b
    elastid explain fit.criterion            meaning, values, default, and when to change it
    elastid explain records/clock            meaning and remedy
    elastid explain k_1                      meaning
    elastid explain k_1 study.yml            joint, side, unit and nominal value
    elastid explain k_1 --run runs/demo      estimate, interval and status in a run
    """
    from elastid.app.explanation import explained
    from elastid.study.reference import overview

    click.echo(printable(overview() if key is None else explained(key, study, folder)))


def one_blas_thread() -> None:
    """Ask every BLAS that is loaded from here on, in this process and its workers, for one thread."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(name, "1")


def explained(error: Exception, arguments: Sequence[str] = ()) -> int:
    """The exit code of an error that has a message for the user; any other is a bug and raised again."""
    match error:
        case ElastidError():
            return _ended(f"{error} [{error.code}]", error.exit_code)
        case click.exceptions.Exit():
            return error.exit_code
        case click.ClickException():
            error.show(file=(text := StringIO()))
            answers = [f"{word} is {renamed(word)}\n" for word in arguments if renamed(word)]
            click.echo(printable("".join([text.getvalue(), *answers])), err=True, nl=False)
            return error.exit_code
        case MemoryError() | ImportError():
            return _ended(f"the study asks for more memory than there is ({error}); shorten its records", 2)
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            advice = "give the command again when there is room, and the files can be read and written, or with --run"
            return _ended(f"{where}{error.strerror or error}; {advice}", 1)
    raise error


# Commands that write at their end alone.
WITHOUT_PARTS = {"map", "tune", "loops", "export", "check", "inspect", "new", "predict"}


def interrupted(arguments: Sequence[str]) -> int:
    """The exit code of a command that was interrupted, which says how to go on."""
    again = shlex.join(["elastid", *arguments])
    if {*arguments[:1]} & WITHOUT_PARTS:
        return _ended(f"interrupted: nothing of it is kept; `{again}` starts again", 130)
    return _ended(f"interrupted: finished stages and parts are kept, and `{again}` resumes from there", 130)


def _ended(message: str, code: int) -> int:
    click.echo(printable(message), err=True)
    return code
