"""The command line: a word for each stage, each calling one function. Heavy imports stay inside the bodies."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click

from elastid import __version__
from elastid.app.process import explained, insisting, interrupted, libraries_off_terminal, one_blas_thread
from elastid.app.stage_table import all_names, help_of
from elastid.base.escape import printable

if TYPE_CHECKING:
    from elastid.app.run import Run

Decorator: TypeAlias = Callable[[Callable[..., Any]], Callable[..., Any]]


def main() -> None:
    """The program `elastid`."""
    # A program that was started without them (`>&-`) has None here, which nothing below expects.
    sys.stdout = sys.stdout or io.StringIO()
    sys.stderr = sys.stderr or io.StringIO()
    sys.exit(run_command(sys.argv[1:]))


def run_command(arguments: Sequence[str]) -> int:
    """A command, and its exit code however it ends (`elastid.app.process`)."""
    try:
        with libraries_off_terminal(), insisting() as pressed:
            cli.main(list(arguments), prog_name="elastid", standalone_mode=False)
    except (KeyboardInterrupt, click.Abort):
        return interrupted(arguments)
    except Exception as error:
        if pressed.is_set():
            return interrupted(arguments)
        return explained(error)
    return 0


def _options(*names: str) -> Decorator:
    """The options of the given names, each the same in every command that takes it."""
    known = {
        "run": click.option("--run", "folder", type=click.Path(path_type=Path), metavar="DIR", help=_RUN_HELP),
        "set": click.option("--set", "overrides", multiple=True, metavar="KEY.PATH=VALUE", help=_SET_HELP),
        "jobs": click.option("--jobs", type=click.IntRange(min=1), metavar="N", help="Processes (default: all cores)."),
        "dask": click.option("--dask", metavar="ADDRESS", default="", help="Work on this Dask scheduler's machines."),
        "pdf": click.option("--pdf", is_flag=True, help="Figures as PDF too, and all on paper: report.pdf."),
        "verbose": click.option("-v", "--verbose", is_flag=True, help="Say more."),
        "quiet": click.option("-q", "--quiet", is_flag=True, help="Only warnings and errors."),
    }

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        for name in reversed(names):
            function = known[name](function)
        return function

    return decorate


_RUN_HELP = "Where the results go (default: runs/<name of the study>)."
_PDF = "report.formats=[png, pdf]"
_SET_HELP = "Overrides a key of the study, for example fit.starts=5."
# The keys of app.export.TARGETS and RESPONSE_TARGETS, which would bring CasADi and SciPy to every command.
_TARGETS = ["robot", "control", "matlab", "mujoco", "fmu", "urdf", "casadi", "c", "csv", "uff", "observer"]
_study = click.argument("study", type=click.Path(path_type=Path))
_stage_options = _options("run", "set", "jobs", "dask", "verbose", "quiet")


class InOrderOfWork(click.Group):
    """A group whose help lists the commands as they are added, each with its first sentence in full."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names in the order in which they were added."""
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Names and first sentences, wrapped and not cut."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, _first_sentence(self.commands[name])) for name in self.list_commands(ctx)])


def _first_sentence(command: click.Command) -> str:
    return " ".join((command.help or "").split("\n\n")[0].split())


@click.group(cls=InOrderOfWork, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="elastid")
def cli() -> None:
    """Identify the elasticity of industrial robots from frequency responses, with honest intervals."""
    one_blas_thread()  # before any command loads NumPy: several threads add in an order of their own


def _run(study: Path, options: dict[str, Any]) -> Run:
    """The study loaded, with its folder and its ways of working."""
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
    "--template",
    type=click.Choice(["serial", "parallel-linkage", "recorded", "ros2", "responses", "frf", "friction"]),
    default="serial",
    show_default=True,
)
def new(folder: Path, template: str) -> None:
    """Write a study to edit, its robot and the schema for editors into a new folder.

    Templates recorded and frf (responses and their peaks, without a robot) come with a small simulated log in logs/.
    """
    from elastid.app import scaffold

    study = scaffold.new(folder, template)
    click.echo(f"{printable(str(study))} is yours to edit; then `elastid check {study}` and `elastid run {study}`")


@cli.command()
@_study
@_options("set")
def check(study: Path, overrides: tuple[str, ...]) -> None:
    """Show all errors of a study with file, line and column, else a summary of the study and its stages."""
    from elastid.app.overview import overview
    from elastid.study import load

    click.echo(printable(overview(load(study, overrides).study)))


def add_stage_commands(group: click.Group) -> None:
    """A command for each row of the table of stages."""
    for name in all_names():
        group.add_command(_stage_command(name))


def _stage_command(name: str) -> click.Command:
    @_study
    @_stage_options
    def work(study: Path, pdf: bool = False, **options: Any) -> None:
        asked = _run(study, options | {"overrides": (*options["overrides"], *([_PDF] if pdf else []))})
        from elastid.app.run import run_stage

        run_stage(asked, name)

    for_print = _options("pdf") if name == "report" else lambda function: function
    return click.command(name, help=help_of(name))(for_print(work))


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
@click.option("--to", "target", type=click.Choice(_TARGETS), required=True, help="The tool that will read it.")
@_stage_options
def export(study: Path, target: str, **options: Any) -> None:
    """Write the identified model for another tool into export/<target>/ of the run folder, with its intervals.

    The target robot is the robot's file with the identified numbers, of a study of elasticity or of friction; observer
    is the filter of a friction study in C; all others take the fitted model of a study of elasticity. A study without a
    robot exports its measured responses to control, matlab, csv or uff; uff takes the responses of any study.
    """
    asked = _run(study, options)
    from elastid.app.export import export as export_model

    export_model(asked, target)


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

    The list has the sections of a study, in its order.
    """
    from elastid.study import reference

    click.echo(printable(reference.overview() if key is None else reference.explain(key)))


@cli.command()
def schema() -> None:
    """Print the JSON Schema of a study, for editors."""
    import json

    from elastid.study import make_schema

    click.echo(json.dumps(make_schema(), indent=1))
