"""One elastic axis that lifts an arm, gravity 3 times its friction, and plans of its passes."""

from typing import Any

from elastid.design.friction import design_friction
from elastid.experiment.plan.friction import FrictionPlan
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction_study.spec import FrictionSpec
from elastid.robot import Body, Frame, Friction, Joint, Limits, LuGre, Motor, Placement, Robot, Spring
from elastid.simulation.spec import ControllerSpec

# Motor side; Nm of the link are a hundred times as many.
LAW = Friction(0.25, stiction=0.34, stribeck_velocity=8.0, lugre=LuGre(30.0, 0.02, 5.0))
LIMITS = Limits((-2.0, 2.0), velocity=2.0, torque=400.0, acceleration=7.0)


def axis(limits: Limits = LIMITS, law: Friction | None = LAW) -> Robot:
    motor = Motor(4e-4, 100.0, viscous=1.5e-3, friction=law)
    joint = Joint("1", axis="y", motor=motor, spring=Spring(1e5, 60.0), limits=limits)
    body = Body("arm", joints=(joint,), mass=20.0, center_of_mass=(0.0, 0.0, 0.4), inertia=1.0)
    return Robot("arm", (body,), frames=(Frame("tool", "arm", Placement(xyz=(0.0, 0.0, 0.8))),))


def experiment(bandwidth_hz: float = 8.0, **simulated: Any) -> ExperimentSpec:
    controller = ControllerSpec(bandwidth_hz)
    return ExperimentSpec({"up": (0.0,)}, simulated=SimulatedSpec(controller=controller, **simulated))


def planned(spec: FrictionSpec, robot: Robot | None = None, bandwidth_hz: float = 8.0) -> FrictionPlan:
    robot = robot or axis()
    return design_friction(spec, robot.driven, experiment(bandwidth_hz), robot, 3)


def rig(spec: FrictionSpec, robot: Robot | None = None, **simulated: Any) -> SimulatedFrictionRig:
    return SimulatedFrictionRig(robot or axis(), experiment(**simulated), planned(spec, robot), 1)
