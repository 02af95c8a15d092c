"""Study of a simulated two-axis robot, which several examples measure within seconds."""

STUDY = """\
name: arm
seed: 1
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
      joints: [{name: 2, axis: y, motor: {inertia: 2e-3, ratio: 80, viscous: 1e-3, coulomb: 0.05},
        spring: {stiffness: 2e4, damping: 40}, limits: {angle: [-90 deg, 90 deg], velocity: 3, torque: 800 N*m}}]
      mass: 20
      center_of_mass: [0.35, 0, 0]
      inertia: 1
excitation: {rate_hz: 200, period: 2 s, band_hz: [2, 40], torque_rms: 20}
experiment:
  configurations: {down: [20 deg, 40 deg], out: [-10 deg, 10 deg], up: [-60 deg, 50 deg], in: [10 deg, 80 deg]}
  simulated:
    truth: {k_1: 3.4e4, k_2: 2.3e4}
    carrier: {amplitude: 0.5 deg, cycles: 1}
    noise: {torque_std: 0.2, encoder_counts: 1048576}
fit: {starts: 1, parameters: {"k_*": {}, "d_*": {}}}
"""
TRUTH = {"k_1": 3.4e4, "k_2": 2.3e4}
