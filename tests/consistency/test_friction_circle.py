"""Friction from passes, from multisine records and from an elastic fit is one friction, on the same simulated robot."""

from dataclasses import replace

import numpy as np
import pytest
from plants.dry_friction import COULOMB, RATIO, measured, measured_robot, robot
from plants.friction_study import friction_study

from elastid.design.friction import design_friction
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import NoiseSpec, SimulatedSpec
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.friction_record import FrictionRecords
from elastid.friction_study.result import FrictionResult
from elastid.friction_study.spec import ConstantVelocitySpec, FrictionSpec, LawSpec
from elastid.nonlinear.compensate_friction import compensate_friction
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.robot import Limits
from elastid.robot.simplified import with_joints
from elastid.simulation.spec import ControllerSpec

AUTO = EstimatorSpec(friction="auto")
LIMITS = Limits((-1.5, 1.5), velocity=2.0, torque=2000.0, acceleration=10.0)
PASSES = ConstantVelocitySpec((0.05, 1.2), count=6, spacing="logarithmic", repeat=1, window=(-0.8, 0.8))
# Standard deviations of a difference that one in a hundred exceeds.
FAR = 2.6


@pytest.fixture(scope="module")
def passes() -> FrictionResult:
    """Of the robot of `dry_friction`, both axes, 3 min of the robot."""
    machine = with_joints(robot(), lambda joint: replace(joint, limits=LIMITS) if joint.motor else joint)
    law = LawSpec(directions="no")
    spec = FrictionSpec(rate_hz=500.0, constant_velocity=PASSES, law=law)
    noise = NoiseSpec(torque_std=0.3, angle_std=1e-7)
    simulated = SimulatedSpec(noise=noise, controller=ControllerSpec(3.0), substeps=4)
    experiment = ExperimentSpec({"a": (0.0, 0.2)}, simulated=simulated)
    plan = design_friction(spec, machine.driven, experiment, machine, 3)
    bench = SimulatedFrictionRig(machine, experiment, plan, 1)
    records = FrictionRecords(tuple(bench.measure(motion) for motion in plan.motions))
    return friction_study(machine, records, spec)


def number_of(result: FrictionResult, name: str) -> tuple[float, float]:
    """A number of the friction study and its standard deviation."""
    found = next(number for number in result.numbers if number.name == name)
    return found.value, found.std


def coulomb_of_both(passes: FrictionResult, taken: CompensatedFriction, joint: str) -> tuple[float, float]:
    """The Coulomb friction by passes and its standard deviation, which multisines do not contradict."""
    (level, std), of_passes = taken.coulomb_friction(f"motor {joint}"), number_of(passes, f"Fc_m{joint}")
    assert abs(level - of_passes[0]) < FAR * np.hypot(std, of_passes[1])
    return of_passes


@pytest.mark.slow
def test_multisines_and_passes_tell_the_same_coulomb_friction(passes: FrictionResult) -> None:
    """At both motors, each within its interval of the truth, and of each other."""
    configurations, lines = measured()
    taken = identify_motor_friction(configurations, AUTO, lines)
    for joint, truth in zip("12", COULOMB, strict=True):
        of_passes, std_of_passes = coulomb_of_both(passes, taken, joint)
        assert abs(of_passes - truth) < FAR * std_of_passes
        slow = np.array([0.05, 0.2])
        curve, curve_std = taken.sliding(f"motor {joint}", slow)
        np.testing.assert_allclose(curve, of_passes, atol=FAR * np.hypot(curve_std, std_of_passes).max())


@pytest.mark.slow
def test_identified_friction_put_back_is_found_by_an_elastic_study(passes: FrictionResult) -> None:
    """Its records show the F_c of passes, and its fit finds their viscous friction beside the springs."""
    machine = robot((0.0, 0.0))
    put = {f"fm_{joint}": number_of(passes, f"f_m{joint}")[0] / n**2 for joint, n in zip("12", RATIO, strict=True)}
    levels = tuple(number_of(passes, f"Fc_m{joint}")[0] for joint in "12")
    configurations, lines = measured_robot(robot(levels).with_parameters(put))
    taken = identify_motor_friction(configurations, AUTO, lines)
    responses = [
        estimate([compensate_friction(one, taken) for one in records], AUTO, lines) for records in configurations
    ]
    chosen = dict.fromkeys(("k_*", "d_*", "fm_*"), ParameterSpec())
    fit = identify(responses, machine, FitSpec(starts=1, start_factor=1.0, profile=(), parameters=chosen))
    for joint, n in zip("12", RATIO, strict=True):
        coulomb_of_both(passes, taken, joint)
        viscous, viscous_std = (n**2 * each[f"fm_{joint}"] for each in (fit.values, fit.std))
        of_passes, std_of_passes = number_of(passes, f"f_m{joint}")
        assert abs(viscous - of_passes) < FAR * np.hypot(viscous_std, std_of_passes)
