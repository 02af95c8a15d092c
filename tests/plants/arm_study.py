"""Studies of the arm with limits and friction, for a move and live, and commands on them."""

from pathlib import Path
from textwrap import indent

from elastid.app import cli
from elastid.robot import Limits
from elastid.study.robots import yaml_text
from plants.arm import robot

LIMITS = (Limits((-1.57, 1.57), 3.0, 1500.0), Limits((-1.57, 1.57), 3.0, 800.0))
TRUTH = {"k_1": 3.4e4, "k_2": 2.3e4}


def study(period: str, configurations: str, cycles: int, further: str = "") -> str:
    """Its text; period: of the excitation.  cycles: of the carrier in it."""
    return f"""\
name: arm
seed: 1
robot:
{indent(yaml_text(robot(viscous=1e-3, coulomb=(0.05, 0.0), limits=LIMITS)), "  ")}\
excitation: {{rate_hz: 200, period: {period}, band_hz: [2, 40], torque_rms: 20}}
experiment:
  configurations: {configurations}
  simulated:
    truth: {{k_1: {TRUTH["k_1"]}, k_2: {TRUTH["k_2"]}}}
    carrier: {{amplitude: 0.5 deg, cycles: {cycles}}}
    noise: {{torque_std: 0.2, encoder_counts: 1048576}}
fit: {{starts: 1, parameters: {{"k_*": {{}}, "d_*": {{}}}}}}
{further}"""


STUDY = study("2 s", "{down: [20 deg, 40 deg], out: [-10 deg, 10 deg]}", 4)
POSTURES = "{down: [20 deg, 40 deg], out: [-10 deg, 10 deg], up: [-60 deg, 50 deg]}"
LIVE = study("1 s", POSTURES, 1, "report: {formats: [png]}\n")


def command(name: str, study: Path, *words: str | Path) -> int:
    """Exit code of a command on a study, whose results are in the folder `run` beside it."""
    return cli.run_command([name, str(study), *map(str, words), "--run", str(study.parent / "run"), "-q"])
