"""The twin of a joint whose friction was identified from a motion, moved along it again."""

from dataclasses import replace

import numpy as np
import pytest
from plants.refusals import refused

from elastid.base.execution import Execution
from elastid.experiment.simulated.plant import true_plant
from elastid.experiment.specs.logs import CascadeSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.inverse_dynamics_regression import regress_motion
from elastid.friction_study.motion_signals import Motion
from elastid.friction_study.result import JointFriction
from elastid.record import Configuration, JointLoop
from elastid.robot import Body, Friction, Joint, Motor, Robot, Spring
from elastid.robot.friction_numbers import with_laws
from elastid.robot.simplified import with_joints
from elastid.simulation.closed_loop import Commands, simulate
from elastid.validation.friction_simulation import compare_friction_logs, predict_logs
from elastid.validation.log_comparison import LINK, MOTION, TORQUE, LogSimulation

RATE_HZ, SECONDS = 500.0, 12.0
COULOMB, VISCOUS = 20.0, 15.0
CASCADE = CascadeSpec(30.0, 400.0, integral_time=0.05, velocity_feedforward=1.0)
TORQUE_STD = 0.2


def swing(mass: float = 20.0) -> Robot:
    """A pendulum on an elastic joint, with friction at its motor; a second joint that rests."""
    motor = Motor(4e-4, 100.0, viscous=VISCOUS / 1e4, friction=Friction(COULOMB / 100))
    joint = Joint("1", axis="y", motor=motor, spring=Spring(1e5, 60.0))
    wrist = Joint("2", axis="z", motor=Motor(1e-4, 50.0))
    return Robot(
        "swing",
        (
            Body("link", joints=(joint,), mass=mass, center_of_mass=(0, 0, -0.4), inertia=1.0),
            Body("hand", "link", joints=(wrist,), mass=1.0, inertia=0.1),
        ),
        gravity=(0.0, 0.0, -9.81),
    )


@pytest.fixture(scope="module")
def record() -> FrictionRecord:
    return recorded()


def recorded(pulse: float = 0.0) -> FrictionRecord:
    """Two sines under the cascade, the arm heavier by 5 kg than the robot's file; pulses of 0.2 s push its motor."""
    robot = swing(25.0)
    plant = true_plant(robot, SimulatedSpec(), RATE_HZ, Configuration("start", np.zeros(2)))
    t = np.arange(round(SECONDS * RATE_HZ)) / RATE_HZ
    reference = np.zeros((len(t), 2))
    reference[:, 0] = 0.5 * (1 - np.cos(2 * np.pi * 0.25 * t)) + 0.1 * np.sin(2 * np.pi * 0.8 * t) ** 3
    velocity, still = np.gradient(reference, 1 / RATE_HZ, axis=0), np.zeros_like(reference)
    pushed = still.copy()
    pushed[:, 0] = np.where(t % 1.7 > 1.5, pulse, 0.0)
    gains = JointLoop(np.array([12000.0, 12000.0]), np.array([400.0, 400.0]), np.array([20.0, 0.0]))
    run = simulate(plant.loop, gains, Commands(reference, velocity, pushed, still, still), plant.point.q)
    noise = TORQUE_STD * np.random.default_rng(1).standard_normal(len(t))
    link = run.q[:, plant.model.index("joint 1")]
    return FrictionRecord(
        "log", "1", "motion", RATE_HZ, run.reading[:, 0], run.u[:, 0] + noise, reference=reference[:, 0],
        link_position=link, configuration=Configuration("log", np.zeros(2)),
        disturbance=pushed[:, 0] if pulse else None,
    )  # fmt: skip


def fitted(record: FrictionRecord) -> tuple[Robot, JointFriction]:
    """The robot's file with the friction that the motion shows, 5 kg too light, and the joint with its motion."""
    motion = Motion("joint 1", RATE_HZ, record.position, record.torque, turns_against_gravity=True)
    found = regress_motion(motion, passband_hz=10.0)
    law = Friction(found.regression["coulomb"])
    joint = JointFriction("1", False, motion=found, friction=law, viscous=found.regression["viscous"])
    return with_laws(swing(), {"1": (law, found.regression["viscous"])}), joint


def runs_of(record: FrictionRecord, controller: CascadeSpec | None) -> tuple[LogSimulation, ...]:
    robot, joint = fitted(record)
    return compare_friction_logs(robot, (joint,), FrictionRecords((record,)), controller, Execution()).runs


def test_simulation_with_other_mass_follows_log(record):
    """By its torque beside a slow loop, and by its reference; the regression of a motion explains it as another log."""
    by_torque, by_reference = runs_of(record, CASCADE)
    for run, most in ((by_torque, (0.003, 0.003, 0.02)), (by_reference, (0.001, 0.001, 0.01))):
        errors = [run.of(kind)[0].error for kind in (MOTION, LINK, TORQUE)]
        assert np.all(np.array(errors) < most), errors
    robot, joint = fitted(record)
    logs = FrictionRecords((record,))
    found, none = (predict_logs(robot, joints, logs, None, Execution()) for joints in ((joint,), ()))
    assert (set(found.missing), set(none.missing), none.runs) == (set(), {"1"}, ())
    (balance,) = found.balances
    assert balance.unexplained_fraction < 1e-3
    assert balance.bands[-1].high_hz == joint.motion.passband_hz
    assert len(balance.measured) / balance.rate_hz == pytest.approx(SECONDS, rel=0.15)


@pytest.mark.slow
def test_known_pulses_push_the_twin_as_well() -> None:
    """Under its controller; one that is not pushed has another torque."""
    pushed = recorded(pulse=60.0)
    assert runs_of(pushed, CASCADE)[1].of(TORQUE)[0].error < 0.03
    assert runs_of(replace(pushed, disturbance=None), CASCADE)[1].of(TORQUE)[0].error > 0.1


def test_simulation_along_a_slow_log_takes_its_steps() -> None:
    """A spring that needs more than 80 steps in a sample of 100 Hz, of which a study may raise the rate."""
    stiff = with_joints(swing(), lambda joint: replace(joint, spring=joint.spring and Spring(1e9, 60.0)))
    spec, start = SimulatedSpec(), Configuration("start", np.zeros(2))
    with refused("experiment/simulated", place="experiment.simulated.substeps", holds="100 Hz"):
        true_plant(stiff, spec, 100.0, start)
    assert true_plant(stiff, spec, 100.0, start, is_free=True).loop.rate_hz == 100.0


def test_uncontrollable_simulation_is_called_lost(record: FrictionRecord) -> None:
    """A velocity gain beyond what the sampled loop bears."""
    _, followed = runs_of(record, CascadeSpec(30.0, 2e4))
    assert followed.lost.startswith("motor 1 ")
    assert not followed.signals
