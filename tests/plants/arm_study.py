"""A study of an arm of two axes with a move, and commands on it."""

from pathlib import Path

from elastid.app import cli

ROBOT = """\
robot:
  name: arm
  bodies:
    - name: upper
      joints: [{name: 1, axis: y, motor: {inertia: 2e-3, ratio: 80, viscous: 1e-3, coulomb: 0.05},
        spring: {stiffness: 4e4, damping: 80}, limits: {angle: [-90 deg, 90 deg], velocity: 3, torque: 1.5 kN*m}}]
      mass: 30
      center_of_mass: [0.4, 0, 0]
      inertia: 1.5
    - name: fore
      parent: upper
      placement: {xyz: [0.8, 0, 0]}
      joints: [{name: 2, axis: y, motor: {inertia: 2e-3, ratio: 80, viscous: 1e-3},
        spring: {stiffness: 2e4, damping: 40}, limits: {angle: [-90 deg, 90 deg], velocity: 3, torque: 800 N*m}}]
      mass: 20
      center_of_mass: [0.35, 0, 0]
      inertia: 1
  frames: [{name: tool, body: fore, placement: {xyz: [0.6, 0, 0]}}]
"""
STUDY = f"""\
name: arm
seed: 1
{ROBOT}excitation: {{rate_hz: 200, period: 2 s, band_hz: [2, 40], torque_rms: 20}}
experiment:
  configurations: {{down: [20 deg, 40 deg], out: [-10 deg, 10 deg]}}
  simulated:
    truth: {{k_1: 3.4e4, k_2: 2.3e4}}
    carrier: {{amplitude: 0.5 deg, cycles: 4}}
    noise: {{torque_std: 0.2, encoder_counts: 1048576}}
fit: {{starts: 1, parameters: {{"k_*": {{}}, "d_*": {{}}}}}}
"""


def command(name: str, study: Path, *words: str | Path) -> int:
    """Exit code of a command on a study, whose results are in the folder `run` beside it."""
    return cli.run_command([name, str(study), *map(str, words), "--run", str(study.parent / "run"), "-q"])
