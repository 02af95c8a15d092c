"""Which effects the records of another simulator show."""

from dataclasses import replace

import numpy as np
import pytest
from plants.gear_levels import SPEC, find_gear_effects, linear_fit
from plants.geared_arms import parallel_linkage
from plants.marks import slow
from plants.two_mass_gear import LINES, Gear, records, robot

from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.fit.identify import identify
from elastid.fit.parameter_selection import choose
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.estimate import estimate
from elastid.linear.linearise import Linearisation
from elastid.nonlinear.basis_functions import GearEffect
from elastid.nonlinear.gear_estimation import GearData, GearEstimate, initial_estimate
from elastid.nonlinear.gear_model_selection import _conflicts, candidate_groups
from elastid.nonlinear.identify_gears import rigid_gears
from elastid.nonlinear.period_lines import gather_lines
from elastid.record import Configuration, Record
from elastid.response import Response
from elastid.robot import Body, Friction, Joint, Motor, Placement, Robot, Spring
from elastid.robot.simplified import with_joints


def found(gear: Gear, substeps: int = 6) -> tuple[GearEstimate, dict[str, float]]:
    """What is chosen, and the numbers of the model beside it."""
    measured = records(gear, substeps=substeps)
    response, linear = linear_fit(gear, measured)
    magnitudes = find_gear_effects([measured], [response], linear, robot(gear))
    return magnitudes, linear.parameters.as_dict(magnitudes.x)


@pytest.mark.parametrize(
    ("gear", "expected"),
    [
        (Gear(), {}),
        slow(Gear(F_l=30.0), {"behind": 30.0}),
        (Gear(F_m=20.0, F_l=12.0), {"friction": 20.0, "behind": 12.0}),
        slow(Gear(F_m=30.0, load=0.1), {"friction": 30.0, "load": 0.1}),
        slow(
            Gear(F_m=20.0, F_l=12.0, k_3=2e9, error=2e-5),
            {"friction": 20.0, "behind": 12.0, "cubic": 2e9, "error sine": 2e-5},
        ),
    ],
)
def test_gear_effects_are_identified_on_their_side(gear: Gear, expected: dict[str, float]) -> None:
    """Magnitudes within 3 % or 3 std, k within 0.1 % and d within 2 %: a linear fit has d 27 % off."""
    # Steps over reversals of a coarser plant are as large as what an error of 2e-5 rad does.
    magnitudes, numbers = found(gear, 24 if gear.error or gear.load else 6)
    by_kind = {
        effect.kind: (f, std)
        for effect, f, std in zip(
            magnitudes.effects, magnitudes.magnitudes.tolist(), magnitudes.std.tolist(), strict=True
        )
    }
    cosine, _ = by_kind.pop("error cosine", (0.0, 0.0))
    assert set(by_kind) == set(expected)
    for kind, (f, std) in by_kind.items():
        assert abs(f - expected[kind]) < max(0.03 * expected[kind], 3 * std), kind
    assert abs(cosine) < 0.03 * expected.get("error sine", 1.0)
    assert numbers["k_1"] == pytest.approx(gear.k, rel=1e-3)
    assert numbers["d_1"] == pytest.approx(gear.d, rel=2e-2)
    assert np.isfinite(magnitudes.covariance).all()
    std = np.sqrt(magnitudes.covariance[(i := magnitudes.parameters.free_names.index("k_1")), i])
    assert (std >= 5e-4) == bool({*expected} - {"friction", "behind"})  # 0.05 % of k beside other effects


@pytest.mark.parametrize(
    ("gear", "expected"),
    [
        (Gear(k_2s=2e7), [("progressive", 2e7, 0.0)]),
        slow(Gear(gap=1e-4), [("gap", 2e5, 1e-4)]),
        (Gear(gap=1e-4, loose=0.3, F_m=20.0), [("friction", 20.0, 0.0), ("gap", 1.4e5, 1e-4)]),
        slow(Gear(ranges=((100.0, 1.4), (300.0, 1.7))), [("range", 6e4, 1e-3 * 17 / 14), ("range", 8e4, 5e-4)]),
    ],
)
def test_springs_have_their_law_and_its_ends(gear: Gear, expected: list[tuple[str, float, float]]) -> None:
    """A progressive one, a gap, lost motion beside friction, K1 K2 K3: ends within 2 % or 3 std, k within 0.05 %."""
    magnitudes, numbers = found(gear)
    every = sorted(
        zip(magnitudes.effects, magnitudes.magnitudes.tolist(), magnitudes.std, magnitudes.scale_std, strict=True),
        key=lambda each: (each[0].kind, each[1]),
    )
    assert [effect.kind for effect, *_ in every] == [kind for kind, *_ in expected]
    for (effect, f, std, scale_std), (kind, magnitude, scale) in zip(every, expected, strict=True):
        assert abs(f - magnitude) < max(0.02 * magnitude, 3 * std), kind
        if scale:
            assert abs(effect.scale - scale) < max(0.02 * scale, 3 * scale_std), kind
    assert numbers["k_1"] == pytest.approx(gear.k, rel=5e-4)


def test_rigid_gear_has_only_motor_friction_candidates() -> None:
    """It brakes the motion that the others' records have; shapes of a deflection that there is none of are left out."""
    hand = Body(
        "hand", joints=(Joint("1", "z", Spring(9e4, 30.0), Motor(6e-4, 100.0, 8e-4)),), mass=20.0,
        center_of_mass=(0.25, 0.02, 0.1), inertia=1.5,
    )  # fmt: skip
    rigid = Joint("2", "y", motor=Motor(3e-4, 100.0, 4e-4))
    tool = Body("tool", "hand", Placement((0.4, 0, 0.1)), (rigid,), 15.0, (0.3, 0.05, 0.02), 1.0)
    plant = Robot("one rigid gear", (hand, tool))
    linearisation, places = Linearisation.of_robot(plant), plant.motor_locations
    parameters = choose(FitSpec(parameters={"k_*": ParameterSpec()}), plant, ["a"])
    posture, (u, y) = (
        Configuration("a", np.array([0.2, 0.3])),
        np.random.default_rng(0).standard_normal((2, 4, 2000, 2)),
    )
    noise = [
        Record(f"r{i}", posture, i, 0, 500.0, 1000, places, places, ("position",) * 2, u[i], 1e-6 * y[i])
        for i in range(4)
    ]
    lines, none = gather_lines(noise, SPEC, LINES), np.zeros((len(LINES), 2, 2), complex)
    G = Response(LINES * 0.5, none, places, places, "acceleration", posture)
    data = GearData([lines], [G], linearisation)
    known = initial_estimate(data, parameters, parameters.x)
    groups = candidate_groups(data, known, (1.0, 2.0))
    assert {effect.kind for group in groups for effect in group if effect.joint == "2"} == {"friction"}
    assert {"behind", "gap", "stop"} < {effect.kind for group in groups for effect in group if effect.joint == "1"}
    assert not any(effect.kind.startswith(("error", "ripple")) for group in groups for effect in group)
    turning = replace(data, lines=[replace(lines, Y=1e5 * lines.Y)])  # several turns of the motors
    assert any(effect.kind == "error sine" for g in candidate_groups(turning, known, (1.0,)) for effect in g)
    (drive,) = known.drives
    assert not drive.directions("gear", 1).any()
    assert drive.directions("motor", 1) @ drive.B == pytest.approx([0.0, 1.0])
    assert (drive.k[1], drive.d[1], drive.torque[1]) == (1.0, 0.0, 0.0)
    (note,) = rigid_gears(["2"])
    assert note.place == "joint 2"


def test_loop_elements_are_added_one_at_a_time() -> None:
    """Two ranges that were added at once met at one end, and k was 7.7 % off beside a std of 0.13 %."""
    added = [GearEffect("range", "1", 1e-3), GearEffect("stop", "2", 1e-4)]
    assert _conflicts(GearEffect("range", "1", 5e-4), added, alone=True)
    assert _conflicts(GearEffect("bristle", "2", 5e-4), added, alone=True)
    assert not _conflicts(GearEffect("range", "1", 5e-4), added)
    for other in (GearEffect("range", "2", 5e-4), GearEffect("stop", "1", 1e-4), GearEffect("friction", "1", 1e-3)):
        assert not _conflicts(other, added, alone=True)


@pytest.mark.slow
def test_friction_on_both_sides_is_found_on_a_parallel_linkage() -> None:
    """Magnitudes within 3 % or 3 std, k within 0.3 % and d within 2 %, where a linear fit has d 5 % off or more."""
    arm, _ = parallel_linkage()
    magnitudes = {("friction", "2"): 40.0, ("behind", "2"): 20.0, ("friction", "3"): 35.0, ("behind", "3"): 18.0}

    def rough(joint: Joint) -> Joint:
        if joint.motor is None:
            return joint
        at_motor, behind = (magnitudes[kind, joint.name] for kind in ("friction", "behind"))
        return replace(joint, motor=replace(joint.motor, coulomb=at_motor / 100), friction=Friction(behind))

    machine, band = with_joints(arm, rough), (2.0, 81.0)
    excitation = MultisineSpec(500.0, 2.0, band, (400.0, 350.0), grid="lines", lines=tuple(LINES.tolist()))
    noise = NoiseSpec(torque_std=0.7, angle_std=2e-7)
    simulated = SimulatedSpec(noise=noise, carrier=CarrierSpec(0.02, 1), substeps=8)
    experiment = ExperimentSpec({"a": (0.2, 0.1)}, 2, 2, 1, simulated=simulated)
    rig = SimulatedRig(machine, experiment, make_plan(excitation, experiment, machine, 3), 3)
    measured = tuple(rig.measure(each) for each in rig.experiments)
    response = estimate(measured, SPEC, LINES)
    free = {key: ParameterSpec() for key in ("k_*", "d_*", "fm_*")}
    linear = identify([response], arm, FitSpec(parameters=free, weights=WeightSpec(model_error=0.0), starts=1))
    found = find_gear_effects([measured], [response], linear, arm)
    numbers, true = linear.parameters.as_dict(found.x), arm.parameters()
    for joint in ("2", "3"):
        assert numbers[f"k_{joint}"] == pytest.approx(true[f"k_{joint}"][0], rel=3e-3)
        assert numbers[f"d_{joint}"] == pytest.approx(true[f"d_{joint}"][0], rel=2e-2)
        assert abs(linear.values[f"d_{joint}"] / true[f"d_{joint}"][0] - 1) > 0.05
    assert {(effect.kind, effect.joint) for effect in found.effects} == set(magnitudes)
    for effect, f, std in zip(found.effects, found.magnitudes.tolist(), found.std.tolist(), strict=True):
        magnitude = magnitudes[effect.kind, effect.joint]
        assert abs(f - magnitude) < max(0.03 * magnitude, 3 * std), effect
