"""A study on an odd-random grid: friction shows on the lines that were left out, from the robot to the report."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from elastid.app.console import Console
from elastid.app.run import Run, run_all
from elastid.base.errors import MisfitError
from elastid.report.figures.fit import quality_figure
from elastid.response import Levels, Response
from elastid.store.measured import read_plan, read_responses
from elastid.study import load

PERIOD = 2  # s
STAGES = ("design", "measure", "estimate", "fit", "validate", "report")


def finished(
    study: Path, folder: Path, coulomb: float, cycles: int, last: str = "report", friction: str = "none"
) -> Run:
    """Up to one stage: one realisation with Coulomb friction (Nm) under a sine carrier of so many cycles a period.

    friction: as in estimator.friction.
    """
    overrides = [
        "excitation.grid=odd-random",
        f"excitation.period={PERIOD}",
        "experiment.realisations=1",
        f"estimator.friction={friction}",
        "report.formats=[png]",
        "experiment.configurations={a: [0]}",
        "experiment.simulated.substeps=12",
        f"experiment.simulated.carrier={{amplitude: 3 deg, cycles: {cycles}}}",
        f"robot.bodies.0.joints.0.motor.coulomb={coulomb}",
    ]
    run = Run(load(study, overrides), folder, 1, Console(-1))
    for stage in STAGES[: STAGES.index(last) + 1]:
        with suppress(MisfitError):  # friction that is left in the responses moves the parameters; all is written
            run_all(run, [stage])
    return run


def above_noise(found: Levels | None) -> float:
    """RMS of a level relative to that of the noise in it."""
    assert found is not None
    return float(np.sqrt(np.mean(found.amplitude**2) / np.mean(found.noise**2)))


def response_of(run: Run) -> Response:
    """The one response in frf.h5."""
    (response,) = read_responses(run.path("estimate"))
    return response


@pytest.mark.parametrize(("cycles", "is_even"), [pytest.param(1, False, marks=pytest.mark.slow), (2, True)])
@pytest.mark.slow
def test_friction_shows_on_the_lines_left_out(tiny: Path, tmp_path: Path, cycles: int, is_even: bool) -> None:
    """Coulomb friction is odd: with an odd carrier on odd lines alone; with an even one on even lines too.

    frf.h5 holds both levels at the plan's detection lines and, of one realisation, the total covariance, which friction
    lifts above the noise; the report draws them.
    """
    run = finished(tiny, tmp_path / "run", 0.01, cycles)
    response, plan = response_of(run), read_plan(run.path("design"))
    quality = response.quality
    assert quality is not None
    assert quality.even is not None
    assert quality.odd is not None
    assert (above_noise(quality.even) > 3) == is_even
    assert above_noise(quality.odd) > 3
    odd, even = (np.rint(found.freq_hz * PERIOD).astype(int) for found in (quality.odd, quality.even))
    assert len(odd) > 10
    assert set(odd.tolist()) <= set(plan.detection.tolist())
    assert np.all(even % 2 == 0)
    assert response.noise is not None
    assert response.total is not None
    assert np.median(response.total.variance / response.noise.variance) > 4
    labels = {line.get_label() for line in quality_figure(response, quality, "title").axes[0].get_lines()}
    assert {"nonlinear, even", "nonlinear, odd", "stochastic nonlinear"} <= labels
