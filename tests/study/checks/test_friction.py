"""A study of friction as YAML gives it: read in SI, every contradiction refused with its place."""

import math
import shutil
from pathlib import Path

import pytest
from plants.paths import TEMPLATES

from elastid.base.errors import StudyError
from elastid.study import load

TEMPLATE = TEMPLATES / "friction"

FULL = """\
friction:
  joints: [1]
  rate_hz: 500 Hz
  constant_velocity:
    {speeds: [1 deg/s, 90 deg/s], count: 10, spacing: logarithmic, window: [-30 deg, 30 deg], repeat: 3,
     reference_every: 10 min}
  loads: [{name: empty}, {name: full, payload: 12 kg, configuration: upright}]
  presliding_loops: {torque: [0.1, 0.9], loops: 8, frequency_hz: 0.4}
  presliding_test: {torque: [0.05, 0.1], band_hz: [5, 60]}
  warm_up: {speed: 60 deg/s, time: 2 h, test_every: 5 min}
  law: {stribeck: yes, exponent: no, quadratic: no, directions: auto, load: yes, temperature: auto,
        presliding: maxwell_slip, elements: 4}
"""


@pytest.fixture
def study(tmp_path) -> Path:
    for file in TEMPLATE.iterdir():
        shutil.copy(file, tmp_path)
    text = (tmp_path / "study.yml").read_text()
    start, stop = text.index("friction:\n  joints"), text.index("# Posture")
    (tmp_path / "study.yml").write_text(text[:start] + FULL + text[stop:])
    return tmp_path / "study.yml"


def test_every_key_is_read_in_si(study: Path) -> None:
    """Angles in rad, hours in seconds; a study with friction is of a kind of its own."""
    loaded = load(study).study
    spec = loaded.as_friction()
    assert loaded.kind == "friction"
    assert spec.designed_passes.window == (pytest.approx(-math.pi / 6), pytest.approx(math.pi / 6))
    assert (spec.warm_up.time, spec.designed_passes.reference_every) == (7200.0, 600.0)
    assert [load.payload for load in spec.loads] == [0.0, 12.0]
    assert [joint.name for joint in loaded.friction_joints] == ["1"]
    assert loaded.experiment.as_simulated().truth["Fc_m1"] == 22.0


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("robot=null", "study.yml:12:1: friction: "),
        ("friction.joints=[arm]", "friction.joints[0]: no driven joint is called 'arm'; there are 1"),
        ("friction.joints=[1, 1]", ": friction.joints: 1 is given twice"),
        ("friction.constant_velocity=detect", ": friction.constant_velocity: detect "),
        ("friction.constant_velocity.speeds=[0.1, 9]", "speeds[1]: joint 1 is limited to 2.094 rad/s"),
        ("friction.constant_velocity.speeds=[1 mm/s, 1 m/s]", "is given in units of m/s, but joint 1 is a rotation"),
        ("friction.constant_velocity.window=[-3, 1]", "the limits of joint 1, -1.745 to 1.745 rad"),
        ("friction.loads.1.configuration=low", "loads[1].configuration: no configuration is called 'low'"),
        ("friction.loads.1.name=empty", "study.yml:18:10: friction.loads: empty is given twice"),
        ("experiment.simulated.truth.Fc_m2=1", "truth.Fc_m2: the robot has no parameter 'Fc_m2'; did you mean 'Fc_m1'"),
        ("experiment.simulated.truth.Fc_m1=1 N", "unit 'N' measures N, not N*m"),
        ("experiment.simulated.truth.Fc_m1=40", "truth.Fc_m1: no robot has this value: friction: stiction (F_s) is 31"),
        ("validation={configurations: [upright]}", "validation.configurations: no stage"),
        ("friction.warm_up.test_every=2 h", "friction.warm_up.test_every: "),
        ("filter={states: [f, f+]}", ": filter.states: "),
        ("gears={}", ": gears"),
    ],
)
def test_contradictions_are_refused(study: Path, override: str, words: str) -> None:
    """Each by the key that is wrong, with its numbers."""
    with pytest.raises(StudyError) as error:
        load(study, (override,))
    assert words in str(error.value).replace(f"{study.parent}/", "")
