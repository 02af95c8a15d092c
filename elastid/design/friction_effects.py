r"""Effects of Coulomb friction on a frequency response: equivalent damping, and a distortion that acts like noise.

.. math:: \tau_c\, \mathrm{sign}(v_c + v) = d\, v + s, \qquad
          d = \frac{\mathrm{Re} \sum_k V_k^* T_k}{\sum_k |V_k|^2}

T_k are the lines of the friction torque, V_k those of the motor's velocity under the multisine, v_c the velocity of the
carrier. d is the best linear approximation, which the fit finds as viscous friction; s depends on the phases, repeats
in every period and averages over realisations only.
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.note import Note
from elastid.excitation.multisine import synthesise
from elastid.experiment.plan.plan import Plan
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.friction.robot_friction import coulomb_levels
from elastid.robot import Robot

# Lines over which the level of the distortion is averaged: it comes from few experiments.
N_SMOOTHED_LINES = 9
# Coulomb friction per rms torque: a multisine whose peaks are three times its rms still slides at a third.
MAX_COULOMB_RATIO = 1 / 3


def friction_level(
    V: ComplexArray, lines: IntArray, period_samples: int, coulomb: FloatArray, carrier_velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """d (n_u,) and E|s_k|^2 (F, n_u) of velocities V (K, F, n_u) in K experiments, link side.

    coulomb (n_u,): Nm.  carrier_velocity (period_samples, n_u): rad/s, of every motor.
    """
    v = np.stack([synthesise(lines, one, period_samples) for one in V]) + carrier_velocity
    T = np.fft.rfft(coulomb * np.sign(v), axis=1)[:, lines] * (2 / period_samples)
    d = np.sum(V.conj() * T, axis=(0, 1)).real / np.sum(np.abs(V) ** 2, axis=(0, 1))
    power = np.mean(np.abs(T - d * V) ** 2, axis=0)
    width = min(N_SMOOTHED_LINES, len(lines))
    window = np.ones(width)
    weight = np.convolve(np.ones(len(lines)), window, "same")
    smooth = np.stack([np.convolve(column, window, "same") / weight for column in power.T], axis=1)
    return d, smooth


def sticking(plan: Plan, robot: Robot, carrier: CarrierSpec | None) -> tuple[Note, ...]:
    """A note for each motor whose Coulomb friction is more than a third of its rms torque (Nm, link side), at rest.

    Under a carrier the joints slide with any multisine.
    """
    if carrier is not None:
        return ()
    # Friction holds shafts, which gears may couple.
    power = np.sum(np.abs(plan.R @ np.linalg.inv(robot.mixing)) ** 2, axis=3) / 2
    rms = np.sqrt(power.sum(axis=(0, 1, 2)) / len(plan.experiments))
    notes = []
    for joint, torque, coulomb in zip(robot.driven, rms.tolist(), coulomb_levels(robot).tolist(), strict=True):
        if coulomb > MAX_COULOMB_RATIO * torque:
            unit = "N" if joint.slides else "N*m"
            notes.append(
                Note(
                    "sticking-motor",
                    f"its Coulomb friction ({coulomb:.3g} {unit}) is more than a third of its rms torque "
                    f"({torque:.3g} {unit}): the joint sticks, and friction looks like stiffness; raise "
                    "excitation.torque_rms or add experiment.simulated.carrier",
                    f"motor {joint.name}",
                )
            )
    return tuple(notes)
