"""A study of two axes that is measured live in some seconds."""

from plants.arm_study import ROBOT

STUDY = f"""\
name: arm
seed: 1
{ROBOT}excitation: {{rate_hz: 200, period: 1 s, band_hz: [2, 40], torque_rms: 20}}
experiment:
  configurations: {{down: [20 deg, 40 deg], out: [-10 deg, 10 deg], up: [-60 deg, 50 deg]}}
  simulated:
    truth: {{k_1: 3.4e4, k_2: 2.3e4}}
    carrier: {{amplitude: 0.5 deg, cycles: 1}}
    noise: {{torque_std: 0.2, encoder_counts: 1048576}}
fit: {{starts: 1, parameters: {{"k_*": {{}}, "d_*": {{}}}}}}
report: {{formats: [png]}}
"""
TRUTH = {"k_1": 3.4e4, "k_2": 2.3e4}
GOAL = "k_*: 0.2 %"
