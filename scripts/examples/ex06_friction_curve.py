"""
Friction curve
==============

Identify the friction of one axis from constant-velocity runs: design, simulation and fit in Python.

The study equals `elastid new friction --template friction`; comments in that file explain every value.
"""

from importlib.resources import files

import elastid as ei
from elastid.design.friction import design_friction
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.friction_record import FrictionRecords
from elastid.friction_study.result import identify_friction
from elastid.friction_study.sliding_friction import identify_sliding_friction
from elastid.study import load_study

study = load_study(str(files("elastid") / "app" / "templates" / "friction" / "study.yml")).study
robot, spec, joints = study.as_robot(), study.as_friction(), study.friction_joints
plan = design_friction(spec, joints, study.experiment, robot, study.seed)
rig = SimulatedFrictionRig(robot, study.experiment, plan, study.seed)
records = FrictionRecords(tuple(rig.measure(motion) for motion in plan.motions))
result = identify_friction(robot, identify_sliding_friction(robot, joints, records), records, spec)
found = {number.name: (number.low, number.high) for number in result.numbers}

if __name__ == "__main__":
    print(result)
    figure = ei.plot.friction_curve(result, joints[0].name)
    figure.savefig("ex06.png")
