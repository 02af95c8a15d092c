"""Example 1: a single elastic joint, from its numbers to its stiffness with an interval, in Python alone.

A motor with a gear of ratio 100 drives a load through an elastic gear. The simulated rig is measured in closed loop,
the response is estimated, and stiffness and damping are fitted from a start that is wrong by a third.
"""

from __future__ import annotations

from elastid import SimulatedRig, estimate, identify, make_plan
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import NoiseSpec, SimulatedSpec
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.spec import EstimatorSpec
from elastid.robot import Body, Joint, Motor, Robot, Spring

joint = Joint("1", "z", Spring(stiffness=3e4, damping=30.0), Motor(inertia=1e-3, ratio=100.0, viscous=1e-3))
robot = Robot("one elastic joint", (Body("load", joints=(joint,), inertia=8.0),), gravity=(0.0, 0.0, 0.0))
true_stiffness = 4e4

excitation = MultisineSpec(rate_hz=500.0, period=4.0, band_hz=(2.0, 60.0), torque_rms=50.0)
experiment = ExperimentSpec(
    configurations={"home": (0.0,)},
    simulated=SimulatedSpec(truth={"k_1": true_stiffness}, noise=NoiseSpec(torque_std=1.0, encoder_counts=2**20)),
)
plan = make_plan(excitation, experiment, robot, seed=1)
rig = SimulatedRig(robot, experiment, plan, seed=1)
response = estimate([rig.measure(e) for e in rig.experiments], EstimatorSpec(), plan.lines)

free = {name: ParameterSpec() for name in ("k_1", "d_1", "fm_1")}
result = identify([response], robot, FitSpec(parameters=free, starts=4, seed=1))
low, high = result.interval("k_1")

if __name__ == "__main__":
    print(f"{result.message}")
    print(f"k_1 = {result.values['k_1']:.0f} N*m/rad, 95 % interval {low:.0f} to {high:.0f}, true {true_stiffness:.0f}")
