"""The command line: a word for each stage, each calling one function. Heavy imports stay inside the bodies.

Exit codes: 0 done; 1 the data or the fit are at fault; 2 usage or study; 3 done and written, but a misfit, not to be
believed as it stands; 130 interrupted.
"""

from __future__ import annotations

import math
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from errno import EDQUOT, EFBIG, ENOSPC
from functools import reduce
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

from elastid import __version__
from elastid.app.signals import insisting, libraries_off_terminal
from elastid.app.stage_table import helps
from elastid.base.errors import ElastidError, StudyError
from elastid.base.escape import printable

if TYPE_CHECKING:
    from elastid.app.run import Run

Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


def main() -> None:
    """The program `elastid`."""
    # A program that was started without them (`>&-`) has None here, which nothing below expects.
    sys.stdout = sys.stdout or StringIO()
    sys.stderr = sys.stderr or StringIO()
    sys.exit(run_command(sys.argv[1:]))


def run_command(arguments: Sequence[str]) -> int:
    """A command, and its exit code however it ends (`elastid.app.cli`)."""
    try:
        with libraries_off_terminal(), insisting() as pressed:
            cli.main(list(arguments), prog_name="elastid", standalone_mode=False)
    except (KeyboardInterrupt, click.Abort):
        return interrupted(arguments)
    except Exception as error:
        return interrupted(arguments) if pressed.is_set() else explained(error)
    return 0


class _Finite(click.FloatRange):
    """A finite number in a range, which nan is in of itself."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number; click's error for nan and inf."""
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


_POSITIVE = _Finite(min=0, min_open=True)

_OPTIONS: dict[str, Decorator] = {
    "run": click.option(
        *("--run", "folder"), type=click.Path(path_type=Path), metavar="DIR",
        help="Where the results go (default: runs/<name of the study>).",
    ),
    "set": click.option(
        *("--set", "overrides"), multiple=True, metavar="KEY.PATH=VALUE",
        help="Overrides a key of the study, for example fit.starts=5.",
    ),
    "jobs": click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes (default: all cores)."),
    "with": click.option(
        *("--with", "source"), type=click.Path(path_type=Path), required=True, metavar="RUN",
        help="Run folder of a study that has identified friction or elasticity, or its friction.h5 or fit.h5.",
    ),
    "log": click.option(
        *("--log", "logs"), type=click.Path(path_type=Path), multiple=True, metavar="FILE",
        help="A log that takes the place of those of the study, with the same channels; give it again for more.",
    ),
    "dask": click.option("--dask", metavar="ADDRESS", default="", help="Work on this Dask scheduler's machines."),
    "pdf": click.option("--pdf", is_flag=True, help="Figures as PDF too, and all on paper: report.pdf."),
    "verbose": click.option("-v", "--verbose", is_flag=True, help="Say more."),
    "quiet": click.option("-q", "--quiet", is_flag=True, help="Only warnings and errors."),
}  # fmt: skip


def _options(*names: str) -> Decorator:
    """The options of the given names, each the same in every command that takes it."""

    return lambda command: reduce(lambda decorated, name: _OPTIONS[name](decorated), reversed(names), command)


_PDF = "report.formats=[png, pdf]"
# The keys of app.export.TARGETS and RESPONSE_TARGETS, which would bring CasADi and SciPy to every command.
_TARGETS = [
    "robot",
    "control",
    "matlab",
    "mujoco",
    "fmu",
    "urdf",
    "casadi",
    "c",
    "csv",
    "uff",
    "draws",
    "observer",
    "compensation",
]
_study = click.argument("study", type=click.Path(path_type=Path))
_stage_options = _options("run", "set", "jobs", "dask", "verbose", "quiet")


class InOrderOfWork(click.Group):
    """A group whose help lists the commands as they are added, each with its first sentence in full."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order in which they were added."""
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Names and first sentences, wrapped and not cut."""
        helps = ((name, (command.help or "").split("\n\n")[0]) for name, command in self.commands.items())
        with formatter.section("Commands"):
            formatter.write_dl([(name, " ".join(text.split())) for name, text in helps])


@click.group(cls=InOrderOfWork, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="elastid")
def cli() -> None:
    """Identify the elasticity of industrial robots from frequency responses, with honest intervals."""
    one_blas_thread()  # before any command loads NumPy: several threads add in an order of their own


def _run(study: Path, options: dict[str, Any]) -> Run:
    from elastid.app.console import Console
    from elastid.app.run import Run, all_cores
    from elastid.base.execution import on_dask
    from elastid.study import load

    click.get_current_context().with_resource(on_dask(options.get("dask", "")))
    loaded = load(study, options.get("overrides", ()))
    folder = options["folder"] or Path("runs") / loaded.study.name
    console = Console(options["verbose"] - options["quiet"])
    return Run(loaded, folder, options["jobs"] or all_cores(), console)


@cli.command()
@_options("run", "jobs", "verbose", "quiet")
def demo(**options: Any) -> None:
    """Identify a simulated three-axis arm, from excitation to report."""
    from elastid.app import scaffold

    folder = options["folder"] or Path("runs") / "demo"
    run = _run(scaffold.demo(folder), {**options, "folder": folder})
    from elastid.app.run import run_all

    run_all(run)


@cli.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--template", default="serial", show_default=True,
    type=click.Choice(["serial", "parallel-linkage", "recorded", "ros2", "responses", "frf", "friction"]),
)  # fmt: skip
@click.option("--from", "logs", multiple=True, type=click.Path(path_type=Path), help="Guess it from these logs.")
@click.argument("more", type=click.Path(path_type=Path), nargs=-1, metavar="")
def new(folder: Path, template: str, logs: tuple[Path, ...], more: tuple[Path, ...]) -> None:
    """Write a study to edit, its robot and the schema for editors into a new folder.

    Templates recorded and frf (responses and their modes, without a robot) come with a small simulated log in logs/.
    """
    from elastid.app import scaffold

    study = scaffold.new_from_logs(folder, logs, more) if logs or more else scaffold.new(folder, template)
    click.echo(f"{printable(str(study))} is yours to edit; then `elastid check {study}` and `elastid run {study}`")


@cli.command()
@_study
@_options("set")
def check(study: Path, overrides: tuple[str, ...]) -> None:
    """Show all errors of a study with file, line and column, its logs opened; else a summary of it and its stages."""
    from elastid.app.overview import overview
    from elastid.study import load_with_logs

    click.echo(printable(overview(load_with_logs(study, overrides).study)))


def add_stage_commands(group: click.Group) -> None:
    """A command for each name in the table of stages."""
    for name, text in helps().items():
        group.add_command(_stage_command(name, text))


def _stage_command(name: str, text: str) -> click.Command:
    @_study
    @_stage_options
    def work(study: Path, pdf: bool = False, **options: Any) -> None:
        asked = _run(study, options | {"overrides": (*options["overrides"], *([_PDF] if pdf else []))})
        from elastid.app.run import run_stage

        run_stage(asked, name)

    return click.command(name, help=text)(_options(*["pdf"] * (name == "report"))(work))


add_stage_commands(cli)


@cli.command()
@_study
@_stage_options
def run(study: Path, **options: Any) -> None:
    """Run all stages in order, except those whose inputs have not changed."""
    asked = _run(study, options)
    from elastid.app.run import run_all

    run_all(asked)


@cli.command()
@click.argument("studies", type=click.Path(path_type=Path), nargs=-1, required=True, metavar="STUDY [STUDY ...]")
@click.option("--search", is_flag=True, help="Search for the elastic gears, joints and rods.")
@_stage_options
def compare(studies: tuple[Path, ...], search: bool, **options: Any) -> None:
    """Rank models by their prediction error on left-out configurations of the first study: compare.json.

    The models are those of the study's section `compare` (by default the robot without motor coupling, and without each
    elastic joint that is not driven), and those of further studies. With --search the models come from a stepwise
    search: it starts from elastic gears of the driven joints alone and frees or stiffens one gear, elastic joint or rod
    at a time; a free one must lower the left-out error by more than its standard error, and the criterion too.
    """
    if search and len(studies) > 1:
        raise click.UsageError(f"--search takes one study, and there are {len(studies)}; leave it out, or the others")
    asked = _run(studies[0], options)
    from elastid.app import compare as comparing
    from elastid.study import load

    if search:
        comparing.search_elasticity(asked)
        return
    comparing.compare(asked, [load(study) for study in studies[1:]])


@cli.command()
@_study
@_options("with", "log")
@_stage_options
def predict(study: Path, source: Path, logs: tuple[Path, ...], **options: Any) -> None:
    """Judge the numbers that another study has identified on logs: prediction.json and prediction.png.

    Of friction, with the rigid body, or of elasticity: the torque that each part of the model explains and leaves, by
    axis and octave, and the motion of the robot simulated along the logs. The logs are those of STUDY, or those given.
    """
    from elastid.app import predict as predicting

    predicting.predict(_run(study, predicting.on_logs(study, logs, options)), source)


@cli.command(name="map")
@_study
@click.option("--frame", metavar="NAME", help="Frame of the robot (default: tool, else the last one).")
@click.option("--path", type=click.Path(path_type=Path), metavar="FILE", help="CSV of joint angles, or of poses.")
@click.option("--grid", is_flag=False, flag_value=12, type=click.IntRange(2, 60), metavar="[N]",
    help="A grid over the workspace, N points along its longest side (12 if not given).")  # fmt: skip
@click.option("--random", type=click.IntRange(1, 100_000), metavar="N",
    help="Random postures (1000 if nothing is given).")  # fmt: skip
@click.option(
    "--load",
    type=float,
    nargs=3,
    default=(0.0, 0.0, -100.0),
    show_default=True,
    metavar="X Y Z",
    help="Force at the frame in N, axes of the base.",
)
@click.option("--cutting", type=float, default=700e6, show_default=True, metavar="N/M^2", help="Cutting coefficient.")
@click.option("--normal", type=float, nargs=3, metavar="X Y Z", help="Normal of the cut (default: the worst one).")
@click.option("--cutting-force", "force", type=float, nargs=3, metavar="X Y Z", help="Its force (default: --normal).")
@click.option("--band", "band_hz", type=float, nargs=2, metavar="LOW HIGH", help="Lines in Hz (default: the modes).")
@_stage_options
def map_command(
    study: Path, frame: str | None, path: Path | None, grid: int | None, random: int | None,
    load: tuple[float, float, float], cutting: float, normal: tuple[float, float, float] | None,
    force: tuple[float, float, float] | None, band_hz: tuple[float, float] | None, **options: Any,
) -> None:  # fmt: skip
    """Map the fitted robot over its workspace: map.html, map.csv and map.h5.

    At every posture of a path, a grid or at random, with the motors held and with intervals: static compliance and its
    softest direction, natural frequencies, largest dynamic compliance, limiting depth of cut without chatter,
    deflection under a load, and the spring that limits it. A path is a CSV file with a column for each driven joint
    (rad, or `1 deg`), or with poses x, y, z in m and rx, ry, rz in rad.
    """
    asked = _run(study, options)
    from elastid.app import map as mapping
    from elastid.use.compliance import Cut

    if band_hz and not 0 < band_hz[0] < band_hz[1]:
        raise click.UsageError(f"--band {band_hz[0]:g} {band_hz[1]:g}: give two rising frequencies above 0 Hz")
    try:
        cut = Cut(load, cutting, normal or None, force or None)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    mapping.map_study(asked, frame, mapping.Postures(path, grid, random), cut, band_hz or None)


@cli.command()
@_study
@click.option("--path", type=click.Path(path_type=Path), required=True, metavar="FILE",
    help="CSV of joint angles or poses, with times in a column t, or without.")  # fmt: skip
@click.option("--time", "duration", type=_POSITIVE, metavar="S", help="Duration in s.")
@click.option("--fastest", is_flag=True, help="The shortest time in which the error is kept.")
@click.option("--error", "error_mm", type=_POSITIVE, default=1.0, show_default=True,
    metavar="MM", help="That the tool may have, as planned.")  # fmt: skip
@click.option("--frame", metavar="NAME", help="Frame that follows the path (default: tool, else the last one).")
@click.option("--rate", "rate_hz", type=_POSITIVE, metavar="HZ",
    help="Of the references (default: that of the study, else 500).")  # fmt: skip
@click.option("--bandwidth", "bandwidth_hz", type=_POSITIVE, default=4.0,
    show_default=True, metavar="HZ", help="Of the drives' position loops, in the simulation.")  # fmt: skip
@click.option("--draws", type=click.IntRange(min=0), default=20, show_default=True, metavar="N",
    help="Robots drawn from the fit, on which limits hold, too.")  # fmt: skip
@_stage_options
def tune(study: Path, path: Path, duration: float | None, fastest: bool, error_mm: float, frame: str | None,
    rate_hz: float | None, bandwidth_hz: float, draws: int, **options: Any) -> None:  # fmt: skip
    """Command a move so that the tool follows its path: tune.csv, tune.h5, tune.html and files for controllers.

    Motor references with velocities and torque feedforward by optimal control of the fitted elastic model with its
    friction, within the limits of the robot's joints, on robots drawn from the fit, too. A path is a CSV file with a
    column for each driven joint (rad, or `1 deg`) or with poses x, y, z in m and rx, ry, rz in rad, and a column t in
    s. Without t it is a way that starts and ends at rest, such as two rows, and --time or --fastest says how long it
    takes; with t these stretch it.
    """
    if duration is not None and fastest:
        raise click.UsageError("--time and --fastest exclude one another; give one of them")
    asked = _run(study, options)
    from elastid.app import tune as tuning

    tuning.tune_study(
        asked, tuning.Command(path, duration, fastest, error_mm / 1e3, frame, rate_hz, bandwidth_hz, draws)
    )


@cli.command()
@_study
@click.option("--path", type=click.Path(path_type=Path), metavar="FILE", help="CSV of joint angles, or of poses.")
@click.option("--random", type=click.IntRange(min=1), metavar="N", help="Random postures (20 if nothing is given).")
@click.option("--payload", "payloads", type=_Finite(min=0), multiple=True, metavar="KG",
    help="At the frame, again for more; 0 for none, too.")  # fmt: skip
@click.option("--frame", metavar="NAME", help="Frame of the robot (default: tool, else the last one).")
@click.option("--bandwidth", "bandwidth_hz", type=_POSITIVE, default=4.0,
    show_default=True, metavar="HZ", help="Of the drives' position loops, which move the modes.")  # fmt: skip
@click.option("--held", is_flag=True, help="Modes of a robot whose motors are held, as by very stiff drives.")
@_stage_options
def shape(study: Path, path: Path | None, random: int | None, payloads: tuple[float, ...], frame: str | None,
    bandwidth_hz: float, held: bool, **options: Any) -> None:  # fmt: skip
    """Rank input shapers for the modes of a region: shapers.csv, shapers.h5, shapers.png.

    ZV, ZVD, EI and the shortest robust one, with their residual vibration over the modes of all postures and payloads
    and the intervals of their frequencies, delay, and the error of the frequencies that they bear.
    """
    asked = _run(study, options)
    from elastid.app import tune as tuning

    if path is not None and random is not None:
        raise click.UsageError("--path and --random exclude one another; give one of them")
    tuning.shape_study(asked, tuning.Region(path, random, payloads, frame, None if held else bandwidth_hz))


@cli.command()
@_study
@click.option("--to", "target", type=click.Choice(_TARGETS), required=True, help="The tool that will read it.")
@click.option("--count", type=click.IntRange(min=1), default=1000, show_default=True, help="Of --to draws.")
@_stage_options
def export(study: Path, target: str, count: int, **options: Any) -> None:
    """Write the identified model for another tool into export/<target>/ of the run folder, with its intervals.

    The target robot is the robot's file with the identified numbers, of a study of elasticity or of friction; draws are
    --count such robots from what the fit knows, as robot files, MJCF and a table; compensation is the friction of the
    motors over velocity in C; observer is the filter of a friction study in C; all others take the fitted model of a
    study of elasticity. A study without a robot exports its measured responses to control, matlab, csv or uff; uff
    takes the responses of any study.
    """
    asked = _run(study, options)
    from elastid.app.export import export as export_model

    export_model(asked, target, count)


@cli.command()
@click.argument("fleet", type=click.Path(path_type=Path))
@_options("run", "jobs", "dask", "verbose", "quiet")
def fleet(fleet: Path, **options: Any) -> None:
    """Run one study over many robots and dates, and report which parameters differ and which drift.

    FLEET is a YAML file that names the study and its members: a list, a table (CSV with the columns robot and date and
    keys of the study), or a pattern of folders. It leaves fleet.parquet, a row for each parameter of each member, and
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
def explain(key: str | None) -> None:
    """Say what a key of a study means and when to change it: `elastid explain fit.criterion`; without KEY, list all.

    The list has the sections of a study, in its order. Of a word that is no key (`elastid explain coherence`) it lists
    the keys, and the arrays in results, that have it in their text.
    """
    from elastid.study import reference

    try:
        click.echo(printable(reference.overview() if key is None else reference.explain(key)))
    except StudyError:
        from elastid.study.words import explain_word  # looks through results, whose classes take long to load

        if not (key and key.isalpha() and (found := explain_word(key))):
            raise
        click.echo(printable(found))


@cli.command()
def schema() -> None:
    """Print the JSON Schema of a study, for editors."""
    import json

    from elastid.study import make_schema

    click.echo(json.dumps(make_schema(), indent=1))


def one_blas_thread() -> None:
    """Ask every BLAS that is loaded from here on, in this process and its workers, for one thread."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
        os.environ.setdefault(name, "1")


def explained(error: Exception) -> int:
    """The exit code of an error that has a message for the user; any other is a bug and raised again."""
    match error:
        case ElastidError():
            return _ended(str(error), error.exit_code)
        case click.exceptions.Exit():
            return error.exit_code
        case click.ClickException():
            error.show(file=(text := StringIO()))
            click.echo(printable(text.getvalue()), err=True, nl=False)
            return error.exit_code
        case MemoryError():
            return _ended(f"the study asks for more memory than there is ({error}); shorten its records", 2)
        case OSError():
            where = f"{error.filename}: " if error.filename else ""
            full = error.errno in (ENOSPC, EDQUOT, EFBIG)
            advice = "; make room, and the same command goes on where it was" if full else ""
            return _ended(f"{where}{error.strerror or error}{advice}", 1)
    raise error


# Commands that write at their end alone.
WITHOUT_PARTS = {"map", "tune", "shape", "export", "check", "inspect", "new", "predict"}


def interrupted(arguments: Sequence[str]) -> int:
    """The exit code of a command that was interrupted, which says how to go on."""
    again = shlex.join(["elastid", *arguments])
    if {*arguments[:1]} & WITHOUT_PARTS:
        return _ended(f"interrupted: nothing of it is kept; `{again}` starts again", 130)
    return _ended(f"interrupted: finished parts are kept, and `{again}` resumes from there", 130)


def _ended(message: str, code: int) -> int:
    click.echo(printable(message), err=True)
    return code
