"""Stage report: all results of a run -> report.html and figures/, for each kind of study with responses."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from elastid.app.console import Console
from elastid.app.parameter_truth import parameter_contents, true_values
from elastid.app.run import Artefacts, Work, Write
from elastid.nonlinear.gear_result import with_gears
from elastid.report.content import DENSE, MODES, ReportContent
from elastid.report.figures.drawings import Drawing, drawings, drawings_of_responses
from elastid.report.page.page import EmbeddedFigure, html, html_of_responses, write_page
from elastid.store.artefacts import Stamp, read_stamp
from elastid.store.measured import read_friction, read_responses, write_modes
from elastid.store.plan import read_forecast, read_peaks, read_plan
from elastid.store.reading import reader
from elastid.store.results import (
    FIT,
    read_comparison,
    read_fit,
    read_gears,
    read_measured_modes,
    read_modelled,
    read_simulation,
    read_validation,
)
from elastid.study import Study

read_modes, read_dense = reader(FIT, "modes", MODES), reader(FIT, "dense", DENSE)


def report(study: Study, work: Work) -> Artefacts:
    """Write the page and figures of an identified robot, with compare.json if it belongs to these responses."""
    files, robot, simulated = work.sources, study.as_robot(), study.experiment.simulated
    plan, estimates, validated = files.get("design"), files["estimate"], files["validate"]
    responses, result = read_responses(estimates), read_fit(files["fit"])
    validation, friction = read_validation(validated), read_friction(estimates)
    modelled, gears = read_modelled(files["fit"]) or (), read_gears(files.get("gears"))
    final = result if gears is None else with_gears(result, gears)
    content = ReportContent(
        *(study.name, validation.verdict, final, tuple(zip(responses, modelled, strict=True)), validation),
        *(read_modes(files["fit"]), work.stamp.study, work.stamp.entries),
        truth=true_values(robot, simulated, study.fit.parameters, friction),
        plan=None if plan is None else read_plan(plan), forecast=None if plan is None else read_forecast(plan),
        limit_use=None if plan is None else read_peaks(plan), robot=robot,
        comparison=read_comparison(work.parts.with_name("compare.json"), read_stamp(estimates) or Stamp()),
        dense=read_dense(files["fit"]), friction=friction, log_comparison=read_simulation(validated),
        contents=parameter_contents(robot, simulated is not None, friction, result.parameters, gears), gears=gears,
        measured_modes=read_measured_modes(validated),
    )  # fmt: skip
    lines = [f"report: {note}" for note in content.missing_modes]
    return page_artefacts(partial(html, content), drawings(content), study, work, lines=lines)


def page_artefacts(
    page: Callable[[list[EmbeddedFigure]], str], embedded: Iterable[Drawing], study: Study, work: Work,
    files: Mapping[str, Write] = MappingProxyType({}), lines: Sequence[str] = (),
) -> Artefacts:  # fmt: skip
    """Return a page with its figures, written after other files; lines: printed before the path of the page."""
    pages = []

    def write(path: Path, stamp: Stamp) -> None:
        with work.execution() as execution:
            pages.append(write_page(page, embedded, path.parent, study.report.formats, execution))

    def report(console: Console) -> None:
        for line in lines:
            console.say(line)
        for page in pages:  # the end of a run of all stages prints the path, too
            (console.say if console.shows_tables else console.detail)(f"report: {page}")

    return Artefacts({**files, "report.html": write}, report)


def report_responses(study: Study, work: Work) -> Artefacts:
    """Write page, figures, modes.csv and modes.h5 of responses without a robot."""
    # Slow imports (SciPy's linear algebra), which the page of a fit does not need.
    from elastid.logs.responses.universal_files import geometry_of_files
    from elastid.modal.estimate import estimate_all_modes
    from elastid.report.responses_content import ResponsesContent, questions_of_responses
    from elastid.targets.csv import write_modes_csv

    estimates, modal = work.sources["estimate"], study.modal
    responses, friction = read_responses(estimates), read_friction(estimates)
    modes = estimate_all_modes(responses, modal)
    # With `auto`, friction is shown only if it was compensated.
    if friction is not None and study.estimator.friction == "auto" and not friction.shapes:
        friction = None
    geometry = modal.geometry or geometry_of_files(study.experiment, work.base)
    band_lines = [np.isin(G.freq_hz, mode_set.at_hz) for G, mode_set in zip(responses, modes, strict=True)]
    shown_responses = tuple(G.lines(band) if band.any() else G for G, band in zip(responses, band_lines, strict=True))
    stamp = work.stamp
    content = ResponsesContent(study.name, shown_responses, modes, stamp.study, stamp.entries, friction, geometry)
    lines = []
    for mode_set in modes:
        frequencies = ", ".join(f"{freq_hz:.4g}" for freq_hz in mode_set.freq_hz)
        mode_text = f"modes at {frequencies} {mode_set.frequency_unit}" if frequencies else "no mode"
        lines.append(f"report: {mode_set.configuration}: {mode_text}")
        lines += [f"report: {mode_set.configuration}: {note.text}" for note in mode_set.notes]
    lines += [f"{question} {' '.join(sentences)}" for question, sentences in questions_of_responses(content)]
    tables: dict[str, Write] = {
        "modes.csv": lambda path, stamp: write_modes_csv(path, modes),
        "modes.h5": lambda path, stamp: write_modes(path, modes, stamp),
    }
    page, drawings = partial(html_of_responses, content), drawings_of_responses(content)
    return page_artefacts(page, drawings, study, work, tables, lines)
