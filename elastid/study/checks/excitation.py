"""The section `excitation` against robot and experiment: counts, units, and enough lines in the right places."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elastid.base.errors import StudyError
from elastid.excitation.grids import line_count_refusal
from elastid.excitation.phases import hadamard
from elastid.excitation.spec import planned_lines
from elastid.experiment.specs.simulated import carrier_refusal
from elastid.fit.parameter_choice import choose
from elastid.study.checks.names import check_units
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath


def check_excitation(study: Study) -> Iterator[Problem]:
    """Given where the rig is simulated; torques for each motor, in its unit; signals that the realisations need."""
    excitation, robot = study.excitation, study.as_robot()
    if excitation is None:
        if study.experiment.simulated is not None:
            yield Problem(("excitation",), "this section is needed where the experiment is simulated", at_key=True)
        return
    if refused := excitation.realisation_refusal(study.experiment.realisations):
        yield Problem(("excitation", "phases"), refused)
    try:
        if excitation.orthogonal == "hadamard":
            hadamard(len(robot.driven))
    except StudyError as error:
        yield Problem(("excitation", "orthogonal"), str(error))
    torque_rms = excitation.torque_rms
    if isinstance(torque_rms, tuple) and (refused := robot.count_refusal(len(torque_rms), "torques")):
        yield Problem(("excitation", "torque_rms"), f"{refused}, or one for all")
    yield from check_units(("excitation", "torque_rms"), torque_rms, robot)


def check_lines(study: Study) -> Iterator[Problem]:
    """Enough lines for an orthogonal set and for the unknowns; some in each band; none where the carrier is.

    Of a study that has no other problem.
    """
    excitation, simulated = study.excitation, study.experiment.simulated
    if excitation is None or simulated is None:
        return
    path: KeyPath = ("excitation", "lines" if excitation.grid == "lines" else "band_hz")
    try:
        planned = planned_lines(excitation, study.seed)
        unknowns = len(choose(study.fit, study.as_robot()).free)
    except StudyError as error:
        yield Problem(path, str(error))
        return
    lines = planned.excited
    needed, noun = max((len(study.as_robot().driven), "motors"), (unknowns, "unknowns"))
    if refused := line_count_refusal(len(lines), needed, noun):
        yield Problem(path, refused)
    freq_hz = lines / excitation.period
    for key, band in (("estimator", study.estimator.band_hz), ("fit", study.fit.band_hz)):
        if band is not None and not any(band[0] <= f <= band[1] for f in freq_hz):
            yield Problem(
                (key, "band_hz"),
                f"none of the excited lines from {freq_hz[0]:g} to {freq_hz[-1]:g} Hz is within [{band[0]:g}, "
                f"{band[1]:g}] Hz; widen this band, or excite lines in it",
            )
    if simulated.carrier is not None:
        analysed = np.concatenate([lines, planned.detection])
        if refused := carrier_refusal(simulated.carrier, analysed, 1 / excitation.period, len(study.as_robot().driven)):
            yield Problem(("experiment", "simulated", "carrier"), refused)
