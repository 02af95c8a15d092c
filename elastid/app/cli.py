"""Command line: each command calls one function. Slow imports are inside the functions.

Exit codes: 0 done; 1 error in the data or the fit; 2 error in usage or study; 3 done and written, but a misfit (a
significant model error); 130 interrupted.
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
    FILE,
    POSITIVE,
    RATE,
    Finite,
    call_with_run,
    libraries_off_terminal,
    numbers_of,
    options_of,
    repeated_interrupts,
    run_of,
    stage_options,
    study_argument,
)
from elastid.app.stage_table import NAMES
from elastid.app.target_table import MODULES
from elastid.base.codes import new_code
from elastid.base.errors import ElastidError, StudyError
from elastid.base.escape import printable


def main() -> None:
    """Run the program `elastid`."""
    # These are None in a program that was started without them (`>&-`).
    sys.stdout = sys.stdout or StringIO()
    sys.stderr = sys.stderr or StringIO()
    register_error("elastid", _ascii_replacement)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="elastid")
    os.environ["MPLBACKEND"] = "agg"  # the backend of a notebook, in whose cells the program runs, may be missing
    sys.exit(run_command(sys.argv[1:]))


def _ascii_replacement(error: Any) -> tuple[str, int]:
    """Replace a character that the terminal cannot print by similar characters (an error handler of codecs)."""
    return _ASCII.get(error.object[error.start], "?"), error.start + 1


_ASCII = {"±": "+-", "–": "-", "─": "-", "°": "deg", "µ": "u", "²": "^2", "·": "*", "…": "...", "Δ": "D"}


def run_command(arguments: Sequence[str]) -> int:
    """Run a command and return its exit code."""
    try:
        with libraries_off_terminal(), repeated_interrupts() as pressed:
            cli.main(list(arguments), prog_name="elastid", standalone_mode=False)
    except (KeyboardInterrupt, click.Abort):
        return report_interrupt(arguments)
    except Exception as error:
        return report_interrupt(arguments) if pressed.is_set() else report_error(error, arguments)
    return 0


# Groups of commands in the order of the help.
_GROUPS = {
    "Start": ("demo", "new", "check", "run"),
    "Look": ("inspect", "explain", "compare", "predict"),
    "Use": ("map", "tune", "loops", "export"),
    "Campaign": ("live", "fleet"),
}


class GroupedCommands(click.Group):
    """Group of commands whose help lists them by purpose, each with the first paragraph of its help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """List the commands in the order of the help."""
        return [name for names in _GROUPS.values() for name in names]

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write names and first paragraphs of all commands."""
        for group, names in _GROUPS.items():
            helps = [(name, (self.commands[name].help or "").split("\n\n")[0]) for name in names]
            with formatter.section(group):
                formatter.write_dl([(name, " ".join(text.split())) for name, text in helps])

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        """Return the command; for the name of a stage, fail with the command that runs the stage."""
        if name in NAMES:
            ctx.fail(f"{name} is a stage: elastid run STUDY {name}")
        return super().get_command(ctx, name)


@click.group(cls=GroupedCommands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="elastid")
def cli() -> None:
    """Identify the elasticity and friction of industrial robots, with confidence intervals."""
    one_blas_thread()  # before NumPy is loaded; with several threads the order of additions varies


@cli.command()
@options_of("run", "jobs", "verbose", "quiet")
def demo(**options: Any) -> None:
    """Identify a simulated three-axis arm, from the excitation to the report (about one minute)."""
    from elastid.app import scaffold

    folder = options["folder"] or Path("runs") / "demo"
    call_with_run("run:run_all", scaffold.demo(folder), {**options, "folder": folder})


@cli.command()
@click.argument("folder", type=FILE, metavar="DIR")
@click.option(
    "--template", default="serial", show_default=True,
    type=click.Choice(["serial", "parallel-linkage", "recorded", "ros2", "responses", "frf", "friction",
                       "position-reference"])
)  # fmt: skip
@click.option(
    "--from", "logs", multiple=True, type=FILE,
    help="Derive the study from these logs, a robot model (URDF, MJCF or robot.yml), or both."
)  # fmt: skip
@click.argument("more", type=FILE, nargs=-1, metavar="")
def new(folder: Path, template: str, logs: tuple[Path, ...], more: tuple[Path, ...]) -> None:
    """Write a new study, its robot model and the schema for editors into a new folder.

    The templates recorded and frf (responses and their modes, without a robot) contain a small simulated log in logs/.
    """
    from elastid.app import scaffold

    study = scaffold.new_from_logs(folder, logs, more) if logs or more else scaffold.new(folder, template)
    click.echo(f"Edit {printable(str(study))}, then run `elastid check {study}` and `elastid run {study}`")


@cli.command()
@study_argument
@options_of("set")
def check(study: Path, overrides: tuple[str, ...]) -> None:
    """Check a study and its logs: show all errors with file, line and column, or a summary with the stages."""
    from elastid.app.overview import overview
    from elastid.study import load_with_logs

    click.echo(printable(overview(load_with_logs(study, overrides).study)))


@cli.command()
@study_argument
@click.argument("stages", nargs=-1, type=click.Choice(NAMES), metavar="[STAGE]...")
@options_of("png")
@stage_options
def run(study: Path, stages: tuple[str, ...], png: bool = False, **options: Any) -> None:
    """Run all stages in order and skip those that are up to date; stages named on the command line always run.

    \b
    design    configurations, excitation, predicted intervals: plan.h5, references/*.csv
    measure   simulated experiments or recorded logs: records.h5
    estimate  frequency responses with covariance: frf.h5
    fit       elastic parameters: fit.h5, summary.json
    gears     (with gears: {}) gear friction, hardening, hysteresis and transmission error: gears.h5
    validate  prediction error on the validation configurations, residual tests: validation.h5
    constant_velocity  (friction study) friction torque by speed, load and temperature: constant_velocity.h5
    friction  (friction study) friction model: friction.h5, summary.json
    follow    (with filter: {}) friction over time, by a Kalman filter: filter.h5
    report    page and, if requested, figures: report.html, figures/
    """
    overrides = (*options["overrides"], *["report.formats=[png]"] * png)
    call_with_run("run:run_all", study, options | {"overrides": overrides}, stages)


@cli.command()
@click.argument("studies", type=FILE, nargs=-1, required=True, metavar="STUDY [STUDY ...]")
@click.option("--search", is_flag=True, help="Search for the set of elastic gears, joints and rods.")
@stage_options
def compare(studies: tuple[Path, ...], search: bool, **options: Any) -> None:
    """Rank models by cross-validation over the configurations of the first study: compare.json.

    The models come from the section `compare` of the study and from further studies. The default is the robot without
    motor coupling, and the robot without each passive elastic joint. With --search the models come from a stepwise
    search, which starts with the gears of the driven joints as the only springs. Each step frees or locks one gear,
    elastic joint or rod. A free one must lower the prediction error by more than its standard error, and QAIC too.
    """
    if search and len(studies) > 1:
        raise click.UsageError(f"--search takes one study, not {len(studies)}. Give one study, or omit --search")
    request = run_of(studies[0], options)
    from elastid.app import compare as comparing
    from elastid.study import load

    if search:
        comparing.search_elasticity(request)
        return
    comparing.compare(request, [load(study) for study in studies[1:]])


@cli.command()
@click.argument("model", type=FILE)
@options_of("with", "log")
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ", help="Sampling rate of the logs (default: by their clock).")
@click.option("--kp", metavar="N[,N...]", callback=numbers_of,
    help="Position gains in N*m/rad, one or one per joint (default: MJCF servos, else the log).")  # fmt: skip
@click.option("--kd", metavar="N[,N...]", callback=numbers_of, help="Velocity gains in N*m*s/rad, likewise.")
@click.option("--delay", type=Finite(min=0, max=1), metavar="S",
    help="Delay of the commands in s (default: the model's, else 0).")  # fmt: skip
@click.option("--study", type=FILE, metavar="STUDY",
    help="Study with the channels of the logs and the controller (default: by the names in the logs).")  # fmt: skip
@stage_options
def predict(
    model: Path, source: Path | None, logs: tuple[Path, ...], rate_hz: float | None, kp: tuple[float, ...],
    kd: tuple[float, ...], delay: float | None, study: Path | None, **options: Any
) -> None:  # fmt: skip
    """Judge a model on logs: prediction.json and prediction.png.

    MODEL --log LOG simulates the joints from the commands of the logs alone; no torque is needed. MODEL is a run
    folder, a robot.yml, a URDF, or an MJCF file with actuators. A log has one command and one position per joint, and
    the controller gains kp and kd (or the options). The result is the rms error by joint and octave, next to three
    trivial predictors: the joint stands still, is at its command, or is there one delay later. Tests find a wrong
    clock, delay, gain or sign. The exit code is 3 if a test finds one, or if a trivial predictor is as good for any
    joint.

    STUDY --with RUN validates the parameters of another run on the logs of a study: the torque that each part of the
    model explains, by axis and octave, and a simulation along the logs. Without --log the logs are from STUDY.
    """
    if source is not None:
        from elastid.app import predict_logs

        predict_logs.predict(run_of(model, predict_logs.on_logs(model, logs, options)), source)
        return
    if not logs:
        raise click.UsageError("give the logs with --log, or the result of another run with --with")
    from elastid.app.console import Console
    from elastid.app.predict_commands import CommandSettings, predict_from_commands
    from elastid.app.run import all_cores
    from elastid.study import load

    folder = options["folder"] or Path("runs") / f"{model.stem}_{logs[0].stem}"
    console = Console(options["verbose"] - options["quiet"])
    recorded = None if study is None else load(study, options["overrides"]).study.experiment.as_recorded()
    settings = CommandSettings(rate_hz, kp, kd, delay, recorded)
    predict_from_commands(model, logs, settings, folder, options["jobs"] or all_cores(), console)


@cli.command(name="map")
@study_argument
@click.option("--frame", metavar="NAME", help="Frame of the robot (default: tool, else the last).")
@click.option("--path", type=FILE, metavar="FILE", help="CSV of joint angles, or of poses.")
@click.option("--grid", is_flag=False, flag_value=12, type=click.IntRange(2, 60), metavar="[N]",
    help="Grid over the workspace with N points along its longest side (default: 12).")  # fmt: skip
@click.option("--random", type=click.IntRange(1, 1_000_000), metavar="N",
    help="Number of random postures (default without path and grid: 1000).")  # fmt: skip
@click.option("--load", type=float, nargs=3, default=(0.0, 0.0, -100.0), show_default=True, metavar="X Y Z",
    help="Force at the frame in N, axes of the base.")  # fmt: skip
@click.option("--cutting", type=float, default=700e6, show_default=True, metavar="N/M^2", help="Cutting coefficient.")
@click.option("--normal", type=float, nargs=3, metavar="X Y Z", help="Normal of the cut (default: worst case).")
@click.option("--cutting-force", "force", type=float, nargs=3, metavar="X Y Z",
    help="Force direction (default: --normal).")  # fmt: skip
@stage_options
def map_command(study: Path, **options: Any) -> None:
    """Map stiffness and modes of the fitted robot over its workspace: map.html, map.csv and map.h5.

    The postures are from a path, a grid or random; the motors are locked. For each posture the map has intervals of the
    static compliance and its softest direction, the natural frequencies, the largest dynamic compliance, the
    chatter-free depth of cut, the deflection under a load, and the spring that contributes most. A path is a CSV file
    with a column for each driven joint (rad, or `1 deg`), or with poses x, y, z in m and rx, ry, rz in rad.
    """
    call_with_run("model_commands:map_study", study, options)


@cli.command()
@study_argument
@click.option("--path", type=FILE, required=True, metavar="FILE",
    help="CSV of joint angles or poses, optionally with a column t for the time.")  # fmt: skip
@click.option("--time", "duration", type=POSITIVE, metavar="S", help="Duration in s.")
@click.option("--fastest", is_flag=True, help="Find the shortest time that keeps the error.")
@click.option("--error", "error_mm", type=POSITIVE, default=1.0, show_default=True,
    metavar="MM", help="Largest error of the tool path.")  # fmt: skip
@click.option("--frame", metavar="NAME", help="Frame that follows the path (default: tool, else the last).")
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ",
    help="Sample rate of the references (default: the study's, else 500).")  # fmt: skip
@click.option("--bandwidth", "bandwidth_hz", type=POSITIVE, default=4.0,
    show_default=True, metavar="HZ", help="Bandwidth of the position loops in the simulation.")  # fmt: skip
@click.option("--samples", type=click.IntRange(0, 200), default=20, show_default=True, metavar="N",
    help="Number of posterior samples that must keep the limits.")  # fmt: skip
@stage_options
def tune(study: Path, **options: Any) -> None:
    """Optimise motor references so that the tool follows a path: tune.csv, tune.h5, tune.html, controller files.

    Optimal control of the fitted elastic model with friction returns motor positions, velocities and feedforward
    torques. The joint limits hold for the fitted robot and for all posterior samples. A path is a CSV file with a
    column for each driven joint (rad, or `1 deg`), or with poses x, y, z in m and rx, ry, rz in rad, and a column t in
    s. Without t the path starts and ends at zero velocity (two rows are enough), and --time or --fastest sets its
    duration. With t these options stretch it.
    """
    call_with_run("model_commands:tune_study", study, options)


@cli.command()
@study_argument
@click.option("--rate", "rate_hz", type=RATE, metavar="HZ", help="Rate of the controller (default: the study's).")
@click.option("--delay", type=click.IntRange(0, 20), metavar="N",
    help="Delay from encoder to torque in samples (default: the study's, else 0).")  # fmt: skip
@click.option("--samples", type=click.IntRange(0, 5000), default=200, show_default=True, metavar="N",
    help="Number of posterior samples, of which 95 % must keep the limit.")  # fmt: skip
@stage_options
def loops(study: Path, **options: Any) -> None:
    """Analyse and design the joint control loops for the fitted robot: loops.html and loops.yml.

    The analysis returns sensitivity peak and bandwidths of the controller in the study. The design returns position and
    velocity gains, notch filters and low-pass filters with the largest bandwidth. Its sensitivity peak stays below 6 dB
    in all postures of the study and for 95 % of the posterior samples. loops.yml has the gains as a section of a study.
    """
    call_with_run("model_commands:loops_study", study, options)


@cli.command()
@study_argument
@click.option("--goal", "goals", multiple=True, required=True, metavar="TEXT",
    help='Half-width of 95 % intervals, such as "k_*: 1 %"; can be repeated.')  # fmt: skip
@click.option("--simulate", is_flag=True, help="Measure the simulated robot of the study.")
@click.option("--robot-time", "robot_time", type=POSITIVE, metavar="S",
    help="Largest robot time in s (default: as in the plan of the study).")  # fmt: skip
@stage_options
def live(study: Path, goals: tuple[str, ...], simulate: bool, robot_time: float | None, **options: Any) -> None:
    """Design, measure and fit one experiment after the other until all intervals reach the goal.

    Each experiment (posture and duration) is the most informative per second of robot time, given all logs so far. It
    keeps the limits for every robot that is consistent with these logs. The references are written into
    DIR/live/references, a file for each run; the command waits for logs of the same names in DIR/live/logs. A log that
    contradicts its plan ends the command. You can interrupt it at any time; the same command resumes. At the end DIR
    contains the results of `elastid run` for the study DIR/live/study.yml. Default of --run: runs/<name of the
    study>-live, with --simulate runs/<name of the study>-live-simulated.
    """
    folder, request = options["folder"], run_of(study, options)
    from elastid.app.live import live_study

    # Simulated logs are never in the folder of the logs of the robot.
    folder = folder or Path("runs") / f"{request.study.name}-live{'-simulated' * simulate}"
    live_study(replace(request, folder=folder), goals, simulate, robot_time)


@cli.command()
@study_argument
@click.option("--to", "target", metavar="TARGET", required=True, help=f"One of {', '.join(MODULES)}.")
@click.option("--count", type=click.IntRange(1, 100_000), default=1000, show_default=True, help="Number of samples.")
@stage_options
def export(study: Path, target: str, count: int, **options: Any) -> None:
    """Write the identified model with its intervals for another tool into export/<target>/ of the run folder.

    `elastid explain export` lists the targets with their content. A study without a robot exports its measured
    responses to control, matlab, csv or uff. Further targets come from installed packages, by entry points of the group
    elastid.targets.
    """
    call_with_run("export:export", study, options, target, count)


@cli.command()
@click.argument("fleet", type=FILE)
@options_of("run", "jobs", "dask", "verbose", "quiet")
def fleet(fleet: Path, **options: Any) -> None:
    """Run one study for many robots and dates, and report the parameters that differ or drift.

    FLEET is a YAML file with the study and its members: a list, or a CSV table with the columns robot, date and keys of
    the study. The results are fleet.parquet, with a row for each parameter of each member, and the page fleet.html.
    Finished members are kept. With --dask the workers of a cluster run the members; they need access to the same files.
    The exit code is 1 if a member failed, and 3 if one is a misfit.
    """
    from elastid.app.console import Console
    from elastid.app.fleet import run_fleet
    from elastid.app.run import all_cores
    from elastid.base.dask_cluster import on_dask
    from elastid.study.fleet import load_fleet

    loaded = load_fleet(fleet)
    folder = options["folder"] or Path("runs") / loaded.name
    console = Console(options["verbose"] - options["quiet"])
    with on_dask(options["dask"]):
        run_fleet(loaded, folder, options["jobs"] or all_cores(), console)


@cli.command()
@click.argument("file", type=FILE)
def inspect(file: Path) -> None:
    """Show the content of a log or result file: names, shapes, units, sample rates, values."""
    from elastid.app.inspection import describe_file

    click.echo(printable(describe_file(file)))


@cli.command()
@click.argument("key", required=False)
@click.argument("study", type=FILE, required=False)
@options_of("run")
def explain(key: str | None, study: Path | None, folder: Path | None) -> None:
    """Explain a key of a study, a code of a message, or a parameter of the robot; without KEY, list all keys.

    \b
    elastid explain fit.criterion            meaning, values, default, and when to change it
    elastid explain records/clock            meaning and remedy
    elastid explain export                   targets of an export (one: export.csv)
    elastid explain causes                   causes of model errors, typical size and remedy
    elastid explain k_1                      meaning and side of the gear
    elastid explain k_1 study.yml            place in the robot model and nominal value
    elastid explain k_1 --run runs/demo      estimate, interval and verdict in a run
    """
    from elastid.app.explanation import explain_name
    from elastid.study.reference import overview

    click.echo(printable(overview() if key is None else explain_name(key, study, folder)))


def one_blas_thread() -> None:
    """Set one thread for every BLAS that is loaded later in this process and its workers."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(name, "1")


def report_error(error: Exception, arguments: Sequence[str] = ()) -> int:
    """Print an error with a message for the user and return its exit code; raise any other error again."""
    match error:
        case ElastidError():
            return _report_end(f"{error} [{error.code}]", error.exit_code)
        case click.exceptions.Exit():
            return error.exit_code
        case click.ClickException():
            error.show(file=(text := StringIO()))
            answers = [f"{word} is {new_code(word)}\n" for word in arguments if new_code(word)]
            click.echo(printable("".join([text.getvalue(), *answers])), err=True, nl=False)
            return error.exit_code
        case MemoryError() | ImportError() if not isinstance(error, ModuleNotFoundError):  # of a shared library
            cause = f"the memory of the process is exhausted ({str(error) or type(error).__name__})"
            return report_error(
                StudyError("run/memory", f"{cause}. Shorten the records, lower --jobs, or raise the limit (ulimit -v)")
            )
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            advice = "Close programs that use it, free disk space or correct permissions, or give another --run"
            return _report_end(f"{where}{error.strerror or error}. {advice}", 1)
    raise error


def report_interrupt(arguments: Sequence[str]) -> int:
    """Print how to resume an interrupted command, and return its exit code."""
    again = shlex.join(["elastid", *arguments])
    # These commands write only at their end.
    if {*arguments[:1]} & {"map", "tune", "loops", "export", "check", "inspect", "new", "predict"}:
        return _report_end(f"interrupted: nothing was written. Start again: `{again}`", 130)
    return _report_end(f"interrupted: finished stages and parts are kept. Resume: `{again}`", 130)


def _report_end(message: str, code: int) -> int:
    click.echo(printable(message), err=True)
    return code
