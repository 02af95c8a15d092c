r"""Temperatures of the joints of a friction study, from the power that friction turns into heat.

.. math:: C \dot T = P - h (T - T_a), \qquad
          T_{k+1} = T_a + (T_k - T_a) e^{-x} + \frac{P_k}{h} (1 - e^{-x}), \quad x = h \Delta t / C

exact over a step of constant power. Hours are not simulated sample by sample: P of a pass, or of a warm-up between its
tests, is the mean of tau_f v at the law's torque and the temperature at the beginning of the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.experiment.plan.friction import FrictionPlan, PlannedWarmUp
from elastid.experiment.plan.passes import PassLimits, PlannedPass, pass_reference, pass_time, planned_pass
from elastid.experiment.specs.heat import HeatSpec
from elastid.friction.robot_friction import frictions
from elastid.robot import Robot

# Rate and number of speeds over which the power of a motion is averaged, and the longest step of constant power.
POWER_RATE_HZ, POWER_SPEEDS, LONGEST_STEP_S = 100.0, 16, 30.0


@frozen_value
class JointHeat:
    """Of one joint: temperature (n + 1,) in degC at time_s (n + 1,), power (n,) in W in between."""

    time_s: FloatArray
    temperature: FloatArray
    power: FloatArray

    def at(self, time_s: FloatArray) -> FloatArray:
        """degC at times (m,)."""
        return np.interp(time_s, self.time_s, self.temperature)


@dataclass(frozen=True)
class _Activity:
    """What a joint does from start_s to end_s; speed (m,): equally likely ones of the motion, none at rest."""

    start_s: float
    end_s: float
    speed: FloatArray


def heat_of(plan: FrictionPlan, robot: Robot, spec: HeatSpec, joint: str) -> JointHeat:
    """The temperature of a joint of the true robot over the whole plan."""
    own = next(one for one in robot.driven if one.name == joint)
    viscous = own.viscous + (own.motor.viscous * own.motor.ratio**2 if own.motor is not None else 0.0)
    laws = [law for law in frictions(robot) if law.place in (f"motor {joint}", f"joint {joint}")]
    times, temperatures, powers = [0.0], [spec.start_degc], list[float]()
    for activity in _activities(plan, joint):
        steps = max(1, math.ceil((activity.end_s - activity.start_s) / LONGEST_STEP_S))
        for end_s in np.linspace(activity.start_s, activity.end_s, steps + 1)[1:].tolist():
            T = temperatures[-1]
            watts = [v * (viscous * v + sum(law.sliding(v, temperature=T) for law in laws)) for v in activity.speed]
            power = sum(watts) / max(1, len(watts))
            fade = math.exp(-(end_s - times[-1]) / spec.time_constant)
            times.append(end_s)
            powers.append(power)
            temperatures.append(spec.ambient + (T - spec.ambient) * fade + power / spec.conductance * (1 - fade))
    return JointHeat(np.array(times), np.array(temperatures), np.array(powers))


def _activities(plan: FrictionPlan, joint: str) -> list[_Activity]:
    """What the joint does without gaps from the start of the plan to its end."""
    limits = next(one.limits for one in plan.designs if one.joint == joint)
    passes = [(one.start_s, one.planned) for one in plan.motions if one.joint == joint and one.planned is not None]
    warm_up = next((one for one in plan.warm_ups if one.joint == joint), None)
    found, clock = list[_Activity](), 0.0
    for start_s, planned in passes:
        found += _between(clock, start_s, warm_up, limits)
        clock = start_s + pass_time(planned, limits)
        found.append(_Activity(start_s, clock, _speeds(planned, limits)))
    found += _between(clock, plan.robot_time_s, warm_up, limits)
    return [one for one in found if one.end_s > one.start_s]


def _between(start_s: float, end_s: float, warm_up: PlannedWarmUp | None, limits: PassLimits) -> list[_Activity]:
    """Rest, and the motion of a warm-up as far as it lies in between."""
    rest = np.zeros(0)
    if warm_up is None:
        return [_Activity(start_s, end_s, rest)]
    low = min(max(warm_up.start_s, start_s), end_s)
    high = max(min(warm_up.start_s + warm_up.time_s, end_s), low)
    speeds = _speeds(planned_pass(warm_up.speed, 0, limits), limits)
    moving = _Activity(low, high, speeds[speeds > 0])
    return [_Activity(start_s, low, rest), moving, _Activity(high, end_s, rest)]


def _speeds(planned: PlannedPass, limits: PassLimits) -> FloatArray:
    """Quantiles of |velocity| over a pass, pauses included."""
    velocity = np.abs(pass_reference(planned, limits, POWER_RATE_HZ).velocity)
    return np.quantile(velocity, (np.arange(POWER_SPEEDS) + 0.5) / POWER_SPEEDS)
