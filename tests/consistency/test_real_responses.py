"""Real records through studies without a robot: the response has the mass and the resonances that are known."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from plants.measured import BENCH, DATA, with_records

from elastid.app import cli
from elastid.response import Response
from elastid.store.measured import read_responses
from elastid.study import load
from elastid.validation.agreement import resonances

ROOT = Path(__file__).parents[2]
EMPS_STUDY = ROOT / "configs" / "real" / "emps_response.yml"
# Motor current in A to the angles of motor and load: the bench of configs/real/motor_bench.yml, nothing known of it.
BENCH_STUDY = f"""
name: bench
experiment:
  configurations: {{bench: []}}
  recorded:
    rate_hz: 2500
    period: 1 s
    channels:
      - {{role: u, at: current, channel: iq_adx, quantity: current, unit: A}}
      - {{role: y, at: motor, channel: theta_mx, quantity: position, unit: rad}}
      - {{role: y, at: load, channel: theta_my, quantity: position, unit: rad, sign: -1}}
    files:
      - {{path: {json.dumps(str(DATA / BENCH))}, configuration: bench}}
report: {{formats: []}}
"""


def ran(study: Path, folder: Path, *overrides: str) -> Response:
    """The response of `elastid run`."""
    options = [part for override in ("report.formats=[]", *overrides) for part in ("--set", override)]
    assert cli.run_command(["run", str(with_records(study)), "--run", str(folder), "-q", *options]) == 0
    (response,) = read_responses(folder / "frf.h5")
    return response


@pytest.mark.parametrize(
    "overrides",
    [(), ("experiment.recorded.period=none", "estimator.method=h1")],
    ids=["as-shipped", "as-one-transient"],
)
def test_the_mass_of_the_axis_is_in_the_response_of_the_shipped_study(
    overrides: tuple[str, ...], tmp_path: Path
) -> None:
    """Force over acceleration above 2 Hz is the published 95.11 kg within 5 %."""
    response = ran(EMPS_STUDY, tmp_path / "run", *overrides)
    assert (response.inputs, response.outputs, response.unit) == (("drive",), ("carriage",), "(m/s^2)/(N)")
    high = response.freq_hz > 2.0
    assert high.sum() > 30
    assert np.median(1 / response.G[high, 0, 0].real) == pytest.approx(95.11, rel=0.05)


def test_the_shipped_study_of_the_axis_says_where_its_record_can_be_had() -> None:
    """Its head has repository, commit and path; with another file in its place it is a study of responses."""
    head = EMPS_STUDY.read_text(encoding="utf-8").partition("\nname:")[0]
    for part in ("github.com/forgi86/sysid-neural-continuous", "956aa7ecd7", "examples/EMPS/data/DATA_EMPS.mat"):
        assert part in head
    assert load(EMPS_STUDY, (f"experiment.recorded.files.0.path={Path(__file__)}",)).study.kind == "frf"


def test_the_bench_as_a_structure_has_its_resonance_and_antiresonance(tmp_path: Path) -> None:
    """Without a robot, per ampere: 54 Hz in the dip of the motor, 76 Hz in the peak of both, within 3 %."""
    (tmp_path / "study.yml").write_text(BENCH_STUDY)
    response = ran(tmp_path / "study.yml", tmp_path / "run")
    assert response.unit == "(rad/s^2)/(A)"
    motor, load_side = response.G[:, 0, 0], response.G[:, 1, 0]
    assert min(resonances(response.freq_hz, motor, sign=-1), key=lambda f: abs(f - 54)) == pytest.approx(54, rel=0.03)
    for side in (motor, load_side):
        assert min(resonances(response.freq_hz, side), key=lambda f: abs(f - 76)) == pytest.approx(76, rel=0.03)
    rows = list(csv.DictReader((tmp_path / "run" / "modes.csv").read_text().splitlines()))
    assert any(abs(float(row["frequency"]) / 76 - 1) < 0.03 for row in rows)
