"""Which parameters a study identifies."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.linkages import LOWER, linkage
from plants.measured_robots import deviation, responses_of
from plants.refusals import refused

from elastid.fit.identify import fit_parameters, identify
from elastid.fit.parameter_selection import AT_TOOL, choose, configuration_groups, with_tolerances
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec, RatioSpec, WeightSpec
from elastid.parameters import Parameter, Parameters, Tie
from elastid.record import Configuration
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Robot, Spring, Tolerances

ROBOT = Robot(
    "arm",
    (
        Body(
            "link",
            joints=(
                Joint("1", spring=Spring(1e5, 100.0), motor=Motor(1e-3, 100.0, viscous=2e-3)),
                Joint("1x", "x", spring=Spring(2e5)),
            ),
            mass=10.0,
            center_of_mass=(0.1, 0.0, 0.0),
            inertia=(1.0, 1.0, 1.0, 0.0, 0.1, 0.0),
        ),
    ),
)


def parameters(**specs):
    return choose(FitSpec(parameters=specs), ROBOT)


def test_positive_quantities_are_logarithmic_the_others_linear():
    """Centres of mass, products of inertia and the delay may be zero or change sign; the rest may not."""
    chosen = parameters(**{name: ParameterSpec() for name in ("k_1", "m_link", "I_link_x*", "c_link_x", "delay")})
    linear = {p.name for p in chosen.free if not p.log}
    assert linear == {"c_link_x", "I_link_xy", "I_link_xz", "delay"}
    assert (chosen["k_1"].lower, chosen["k_1"].upper) == pytest.approx((1e3, 1e7))
    assert (chosen["delay"].lower, chosen["delay"].upper) == (-0.05, 0.05)
    assert math.isinf(chosen["c_link_x"].upper)


def test_fixed_tied_and_known_beforehand():
    """A fixed start is the value, a tie follows, a prior is kept."""
    chosen = parameters(
        k_1=ParameterSpec(prior=PriorSpec(mean=1.1e5, std=0.05)),
        k_1x=ParameterSpec(tie=Tie("k_1", 2.0)),
        d_1=ParameterSpec(start=50.0, fixed=True),
        m_link=ParameterSpec(start=9.0, prior=PriorSpec(std=0.02)),
    )
    assert chosen.free_names == ("k_1", "m_link")
    assert chosen["m_link"].value == 9.0
    assert chosen["m_link"].prior.mean == ROBOT.parameters()["m_link"][0]  # without a mean, the robot's number
    assert chosen["d_1"].value == 50
    assert chosen["k_1"].prior.std == 0.05
    assert chosen.as_dict()["k_1x"] == pytest.approx(2e5)


def test_the_tolerance_of_a_rod_is_relative_to_its_length():
    robot, spec = replace(linkage(), tolerances=Tolerances(length=2e-3)), FitSpec()
    rod = with_tolerances(choose(spec, robot), robot, spec)["l_rod"]
    assert rod.prior.std == pytest.approx(2e-3 / LOWER)


@pytest.mark.parametrize(
    ("specs", "place"),
    [
        ({"k1": ParameterSpec()}, ""),
        ({"q_*": ParameterSpec()}, ""),
        ({"d_1x": ParameterSpec()}, ""),
        ({"k_1": ParameterSpec(bounds=(1.0, 2.0))}, ""),
        ({"k_1": ParameterSpec(bounds=(2e5, 1e5))}, ""),
        ({"k_1": ParameterSpec(tie=Tie("k_9"))}, ""),
        ({"k_1": ParameterSpec(prior=PriorSpec(mean=-1.0, std=0.1))}, ".k_1.prior"),
        ({"k_1": ParameterSpec(prior=PriorSpec(mean=1e5, std=600.0))}, ".k_1.prior.std"),
        ({"k_1": ParameterSpec(fixed=True)}, ""),
        ({"d_1": ParameterSpec(tie=Tie("k_1", by="b"))}, ""),
        ({"d_1": ParameterSpec(tie=Tie("k_*"))}, ".d_1"),
        ({"fm_1": ParameterSpec(per={"a": ("c1",), "b": ("c1",)})}, ""),
    ],
)
def test_what_cannot_be_chosen_is_refused_with_the_way_out(specs, place):
    """Unknown names, zero starts, bounds that exclude the start, ties to nothing, nothing free, groups that overlap."""
    with refused("fit/parameters", place=f"fit.parameters{place}"):
        choose(FitSpec(parameters=specs), ROBOT, ["c1"])


def test_a_ratio_with_the_name_of_a_number_is_refused():
    tied = {"d_1": ParameterSpec(tie=Tie("k_1", by="k_1"))}
    with refused("fit/parameters", place="fit.parameters"):
        choose(FitSpec(parameters=tied, ratios={"k_1": RatioSpec(1.0)}), ROBOT)


FREQ = np.linspace(2, 60, 60)


def bench(viscous=1e-3, k=100.0) -> Robot:
    """Two axes about the vertical, one upon the other, each with an elastic gear."""
    lower = Body("lower", joints=(Joint("1", "z", Spring(2 * k, 0.1), Motor(1e-3, viscous=viscous)),), inertia=5e-3)
    upper = Body("upper", "lower", joints=(Joint("2", "z", Spring(k, 0.05), Motor(1e-3, viscous=1e-3)),), inertia=2e-3)
    return Robot("bench", (lower, upper), gravity=(0.0, 0.0, 0.0))


def measure(robot: Robot, name: str, rng: np.random.Generator, relative: float = 0.01) -> Response:
    return responses_of(robot, {name: (0.0, 0.3)}, rng, FREQ, relative, 0.01 * relative)[0]


def test_one_ratio_damps_all_springs():
    """d = beta k with one beta for both dampers, and as a loss factor at 10 Hz: beta = eta / (2 pi 10)."""
    data = [measure(bench(), "c1", np.random.default_rng(1))]
    for tie, start, truth in (
        (Tie("k_*", by="ratio"), 2e-3, 5e-4),
        (Tie("k_*", 1 / (20 * np.pi), "ratio"), 0.1, 5e-4 * 20 * np.pi),
    ):
        spec = FitSpec(
            parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec(tie=tie), "fm_*": ParameterSpec()},
            ratios={"ratio": RatioSpec(start)},
            starts=4,
        )
        result = identify(data, bench(), spec)
        assert "ratio" in result.parameters.free_names
        assert deviation(result, "ratio", truth) < 4
        assert result.values["d_2"] / result.values["k_2"] == pytest.approx(result.values["d_1"] / result.values["k_1"])


def test_the_jacobian_of_products_follows_from_differences():
    """A tie to two free parameters, one to a fixed and a free one, a stand-in; logarithmic and linear."""
    parameters = Parameters(
        (
            Parameter("k", 3.0, log=True),
            Parameter("c", 2.0),
            Parameter("d", 1.0, tie=Tie("k", 0.5, "beta")),
            Parameter("e", 1.0, tie=Tie("m", 2.0, "c")),
            Parameter("m", 4.0, free=False),
            Parameter("k@a", 5.0, log=True, only=("a",)),
            Parameter("beta", 0.1, log=True, ratio=True),
        )
    )
    assert parameters.names == ("k", "c", "d", "e", "m")
    x = parameters.x + 0.1
    for where in ("", "a", "b"):
        J = np.column_stack(
            [
                (parameters.expand(x + step, where) - parameters.expand(x - step, where)) / 2e-6
                for step in 1e-6 * np.eye(4)
            ]
        )
        np.testing.assert_allclose(parameters.jacobian(x, where), J, atol=1e-8)
    assert parameters.expand(x, "a")[0] == pytest.approx(5.0 * np.exp(0.1))
    assert parameters.dependent_names("a") == ("k", "c", "d", "e")


@pytest.fixture
def data() -> list[Response]:
    rng = np.random.default_rng(2)
    return [measure(bench(), name, rng) for name in ("c1", "c2", "c3")]


def renamed(response: Response, name: str, angles=(0.0, 0.3)) -> Response:
    return replace(response, configuration=Configuration(name, angles))


def test_wrong_sets_of_responses_are_named(data):
    """No response, one twice, angles missing or of another robot, an input or output that the robot lacks."""
    spec = FitSpec(starts=1)
    for given in (
        [],
        [data[0], data[1], renamed(data[2], "c1")],
        [data[0], renamed(data[1], "c2", ())],
        [data[0], renamed(data[1], "c2", (0.0,) * 6)],
        [data[0], replace(data[1], inputs=("motor 1", "motor 7"))],
        [data[0], replace(data[1], outputs=("motor 1", "tool"))],
        [replace(data[0], has_rate=False), data[1]],
    ):
        with refused("fit/responses"):
            identify(given, bench(), spec)


def test_a_configuration_of_another_robot_is_named(data):
    """The same axes, but twice as soft: the fit cannot follow both, and says which one stands apart."""
    foreign = measure(bench(k=60.0), "c4", np.random.default_rng(3))
    result = fit_parameters([*data, foreign], bench(), FitSpec(starts=1))
    assert ("fit/inconsistent-responses", "configuration c4") in [(note.code, note.place) for note in result.notes]


def test_profiles_and_bootstrap_of_a_study_are_in_the_result(data):
    """Asked for by pattern; the intervals are about those of the covariance, NaN where not asked for."""
    spec = FitSpec(starts=2, profile=("k_*",), bootstrap=40, weights=WeightSpec(model_error=0.0))
    result = identify(data[:1], bench(), replace(spec, seed=1))
    for i, name in enumerate(result.parameters.free_names):
        low, high = result.interval(name)
        drawn = np.log(result.bootstrap95[i, 1] / result.bootstrap95[i, 0])
        assert 0.5 < drawn / np.log(high / low) < 1.4  # intervals grant the residuals more than the noise alone does
        if name.startswith("k_"):
            np.testing.assert_allclose(result.profile95[i], (low, high), rtol=0.005)
        else:
            assert np.isnan(result.profile95[i]).all()
    with refused("fit/parameters", place="fit.profile"):
        identify(data[:1], bench(), replace(spec, profile=("k_9",), bootstrap=0))


def test_a_parameter_that_is_known_roughly_gets_its_profile_unasked(data):
    """A damper that the data hardly see: an interval that is not symmetric in the logarithm."""
    rng = np.random.default_rng(0)
    noisy = [measure(bench(), name, rng, relative=0.4) for name in ("c1", "c2")]
    spec = FitSpec(starts=2, weights=WeightSpec(model_error=0.0))
    result = identify(noisy, bench(), replace(spec, seed=1))
    names = result.parameters.free_names
    profiled = [name for name, row in zip(names, result.profile95, strict=True) if not np.isnan(row).any()]
    assert {name for name in names if result.std[name] > 0.15 * result.values[name]} <= set(profiled)
    assert {"fm_1", "fm_2"} <= set(profiled)
    assert "fit/profile" in {note.code for note in result.notes}
    assert not len(identify(noisy, bench(), replace(spec, profile=(), seed=1)).profile95)
    well = identify(data, bench(), replace(spec, seed=1))
    springs = [i for i, name in enumerate(names) if name.startswith(("k_", "d_"))]
    assert not len(well.profile95) or np.isnan(well.profile95[springs]).all()


def bodied(inertia=(0.02, 0.03, 0.04, 0.001, 0.0, 0.002)) -> Robot:
    """A driven axis under two elastic rotations: every axis of the body's inertia is felt."""
    joints = (
        Joint("1", "z", Spring(100.0, 0.05), Motor(1e-3, viscous=1e-3)),
        Joint("x", "x", Spring(200.0, 0.1)),
        Joint("y", "y", Spring(300.0, 0.1)),
    )
    body = Body("arm", joints=joints, mass=2.0, center_of_mass=(0.05, 0.03, 0.02), inertia=inertia)
    return Robot("bodied", (body,), gravity=(0.0, 0.0, 0.0))


def of_body(robot: Robot, rng: np.random.Generator) -> Response:
    return responses_of(robot, {"c1": (0.0,)}, rng, FREQ, 0.01, 0.0, ("joint 1", "joint x", "joint y"))[0]


def test_an_inertia_stays_one_that_a_body_can_have():
    """A body as thin as a sheet, whose largest moment is the sum of the others, with the others held 10 % too small."""
    sheet = bodied((0.02, 0.03, 0.0499, 0.0, 0.0, 0.0))
    held = {"I_arm_xx": ParameterSpec(start=0.018, fixed=True), "I_arm_yy": ParameterSpec(start=0.027, fixed=True)}
    spec = FitSpec(parameters=held | {"I_arm_zz": ParameterSpec(start=0.03), "k_1": ParameterSpec()}, starts=2)
    start = bodied((0.018, 0.027, 0.03, 0.0, 0.0, 0.0))
    result = fit_parameters([of_body(sheet, np.random.default_rng(1))], start, spec)
    assert 0.044 < result.values["I_arm_zz"] < 0.045
    assert ("fit/impossible-inertia", "body arm") in [(note.code, note.place) for note in result.notes]


@pytest.mark.slow
def test_mass_centre_and_inertia_are_identified_from_many_starts():
    """M depends on m c^2: far starts, and impossible ones, end at the truth."""
    free = ("m_arm", "c_arm_x", "I_arm_xx", "I_arm_yy", "I_arm_zz", "k_1", "k_x")
    truth = bodied(inertia=(0.02, 0.03, 0.04, 0.0, 0.0, 0.0))
    start = replace(truth, bodies=(replace(truth.bodies[0], mass=3.0, center_of_mass=(0.09, 0.03, 0.02)),))
    spec = FitSpec(parameters={name: ParameterSpec() for name in free}, starts=4, weights=WeightSpec(model_error=0.0))
    for seed in range(2):
        result = identify([of_body(truth, np.random.default_rng(seed))], start, replace(spec, seed=seed))
        x = np.array([p.to_x(truth.parameters()[p.name][0]) for p in result.parameters.free])
        assert result.status == "converged"
        assert result.n_converged_starts >= 3
        assert np.all(np.abs(result.x - x) < 4 * np.sqrt(np.diag(result.covariance)))


def test_a_start_that_no_body_can_have_is_named():
    spec = FitSpec(parameters={"I_arm_zz": ParameterSpec(start=0.2)}, starts=2)
    with refused("fit/parameters", place="fit.parameters"):
        identify([of_body(bodied(), np.random.default_rng(3))], bodied(), spec)


def test_unknown_motor_friction_starts_at_one_second_decay():
    """1e-3 kg m^2 and 1 s: 1e-3 Nms/rad, within a factor of 100; a number of the file is taken as it is."""
    unknown = choose(FitSpec(parameters={"fm_*": ParameterSpec()}), bench(viscous=0.0))
    assert (unknown["fm_1"].value, unknown["fm_2"].value) == (1e-3, 1e-3)
    assert unknown["fm_1"].lower < 1e-5 * 1.01
    known = choose(FitSpec(parameters={"fm_*": ParameterSpec()}), bench(viscous=5e-3))
    assert known["fm_1"].value == 5e-3
    set_by_hand = choose(FitSpec(parameters={"fm_*": ParameterSpec(start=2e-2)}), bench(viscous=0.0))
    assert set_by_hand["fm_1"].value == 2e-2


def test_tool_responses_belong_to_group_of_their_posture() -> None:
    groups = configuration_groups("k_1", ParameterSpec(per="configuration"), {}, ["a", "b", f"b{AT_TOOL}"])
    assert groups == {"a": ("a",), "b": ("b", f"b{AT_TOOL}")}
