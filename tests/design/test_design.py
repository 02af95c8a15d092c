"""From a study to a plan with its forecast: choice, robot time, earlier measurements, what is reported and refused."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused

import elastid
from elastid.app.stages.design import forecast_table
from elastid.base.arrays import FloatArray
from elastid.design.design import design, presliding, sticking_notes
from elastid.design.forecast import Forecast
from elastid.design.predicted_response import friction_linearisation
from elastid.design.problem import DesignProblem
from elastid.design.spec import CandidateSpec, DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Plan, make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, NoiseSpec, SimulatedSpec
from elastid.fit.identify import fit_parameters
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.nonlinear.net_response import estimate_net_response
from elastid.response import Response
from elastid.robot import Body, Friction, Joint, Limits, LuGre, Motor, Placement, Robot, Spring, Tolerances
from elastid.robot.simplified import with_joints
from elastid.robot.tolerances import EXACT
from elastid.simulation.spec import ControllerSpec

# A planar arm without gravity.
LIMITS = Limits((-2.0, 2.0))
TWO = Robot(
    "two axes",
    (
        Body(
            "upper",
            joints=(Joint("1", "z", Spring(2000, 2), Motor(1e-3, 30, 1e-3), limits=LIMITS),),
            mass=5.0,
            center_of_mass=(0.2, 0, 0),
            inertia=0.1,
        ),
        Body(
            "fore",
            "upper",
            Placement((0.4, 0, 0)),
            (Joint("2", "z", Spring(800, 1), Motor(4e-4, 30, 1e-3), limits=LIMITS),),
            3.0,
            (0.2, 0, 0),
            0.05,
        ),
    ),
    gravity=(0, 0, 0),
)
NOISE = NoiseSpec(torque_std=0.3, angle_std=1e-5)
PROBLEM = DesignProblem(
    robot=TWO,
    excitation=MultisineSpec(500.0, 1.0, (3.0, 60.0), (5.0, 2.0)),
    experiment=ExperimentSpec(ramp=0.0, simulated=SimulatedSpec(noise=NOISE)),
    fit=FitSpec(parameters=dict.fromkeys(("k_*", "d_*"), ParameterSpec()), starts=1, weights=WeightSpec(1e-3)),
    quantity="acceleration",
    seed=1,
    design=DesignSpec(count=3, candidates=CandidateSpec(random=60)),
)


def _measured(problem: DesignProblem, plan: Plan, seed: int) -> list[Response]:
    rig = SimulatedRig(problem.robot, problem.experiment, plan, seed)
    runs = {c.name: [e for e in plan.experiments if e.configuration.name == c.name] for c in plan.configurations}
    groups, spec = (
        [[rig.measure(run) for run in each] for each in runs.values()],
        EstimatorSpec(friction=problem.friction),
    )
    friction = identify_motor_friction(groups, spec, plan.lines) if problem.friction != "none" else None
    return [estimate_net_response(group, friction, spec, plan.lines, None, problem.robot) for group in groups]


def _with(**changes: object) -> DesignProblem:
    assert PROBLEM.design is not None
    return replace(PROBLEM, design=replace(PROBLEM.design, **changes))


@pytest.mark.slow
def test_fits_of_robots_with_tolerances_have_forecast_std() -> None:
    """Predicted over fitted standard deviation, the median of three robots: 0.8 to 1.25 for each stiffness and damper.

    With the default floor; the part by noise likewise.
    """
    postures = {"a": (0.3, 0.8), "b": (0, 1.8), "c": (-1, -0.4)}
    experiment = replace(PROBLEM.experiment, realisations=4, configurations=postures)
    robot, fit = replace(TWO, tolerances=Tolerances()), replace(PROBLEM.fit, weights=WeightSpec())
    problem = replace(PROBLEM, robot=robot, design=None, experiment=experiment, fit=fit)
    designed = design(problem)
    forecast, ratios = designed.forecast, []
    np.testing.assert_allclose(np.linalg.norm([*forecast.std_contributions.values()], axis=0), forecast.std)
    for seed in range(3):
        rng, relative = np.random.default_rng(seed), {"m_": 0.03, "Jm": 0.05, "I_": 0.1}
        numbers = [(name, value) for name, (value, _) in TWO.parameters().items() if name[:2] in relative]
        truth = {name: value * math.exp(relative[name[:2]] * rng.standard_normal()) for name, value in numbers}
        truth |= {name: 0.2 + 0.01 * rng.standard_normal() for name in ("c_upper_x", "c_fore_x")}
        off = replace(problem, experiment=experiment.with_truth(truth))
        result = fit_parameters(_measured(off, designed.plan, seed), robot, fit)
        assert result.status == "converged"
        names = zip(forecast.std, forecast.std_contributions["std_noise"], forecast.parameters, strict=True)
        ratios.append([(std / result.std[n], noise / result.std_noise[n]) for std, noise, n in names])
    ratio = np.median(ratios, axis=0)
    assert np.all((ratio[:, 0] > 0.8) & (ratio[:, 0] < 1.25)), ratio
    assert np.all((ratio[[0, 2], 1] > 0.8) & (ratio[[0, 2], 1] < 1.25)), ratio


def test_std_of_logarithms_are_relative():
    parts = ("",) * 2, np.array([-2.0, -4.0]), (True, False), np.diag([0.01, 0.04]), ("a",)
    forecast = Forecast(("k_1", "c"), *parts, np.ones(1), np.ones((1, 1, 2)), ())
    np.testing.assert_allclose([forecast.std, forecast.relative], [[0.2, 0.2], [0.1, 0.05]])


def test_an_exact_file_has_no_part_in_the_forecast() -> None:
    """The table then has no columns for it."""
    forecast = design(GIVEN).forecast
    assert not len(forecast.variance_fractions)
    assert not forecast.std_contributions
    assert "std_prior" not in forecast_table(forecast)[0]
    within = design(replace(GIVEN, robot=replace(TWO, tolerances=Tolerances()))).forecast
    assert forecast_table(within)[0][3:5] == ["std_noise", "std_prior"]
    assert len({len(row) for row in forecast_table(within)}) == 1


GIVEN = replace(PROBLEM, design=None, experiment=replace(PROBLEM.experiment, configurations={"a": (0.3, 0.8)}))


def test_coulomb_damping_and_scatter_equal_theory() -> None:
    """sign of a Gaussian velocity: d = sqrt(2 / pi) tau / sigma, and the scattered power of van Vleck's arcsine."""
    rng = np.random.default_rng(0)
    N, lines = 16384, np.arange(1, 1500)
    V = np.exp(2j * np.pi * rng.random((20, len(lines), 1))) * math.sqrt(2 / len(lines)) * 0.3
    d, power = friction_linearisation(V, lines, N, np.array([5.0]), np.zeros((N, 1)))
    assert d[0] == pytest.approx(math.sqrt(2 / math.pi) * 5.0 / 0.3, rel=0.01)
    # Van Vleck: sign has the autocorrelation 2 / pi asin(rho); less its linear part, the power within the band.
    band = np.zeros(N // 2 + 1)
    band[lines] = 1 / len(lines)
    rho = np.fft.irfft(band) * N / 2
    scattered = np.fft.rfft(2 / np.pi * (np.arcsin(np.clip(rho, -1, 1)) - rho)).real[lines] * 2 / N
    assert power.sum() / 2 / 25 == pytest.approx(scattered.sum(), rel=0.02)
    fast, _ = friction_linearisation(V, lines, N, np.array([5.0]), np.full((N, 1), 3.0))
    assert abs(fast[0]) < 1e-6 * d[0]


def test_information_is_a_function_of_powers_in_the_closed_loop() -> None:
    """Injected torques are |I + F P| times those that act; one experiment of two motors informs half as much as two.

    Distortion and the floor of the weights do not decrease with power.
    """
    controller = ControllerSpec(2.0, kind="cascade", delay_samples=1)
    experiment = replace(GIVEN.experiment, simulated=SimulatedSpec(noise=NOISE, controller=controller))
    largest = []
    for floor, distortion in ((0.0, 0.0), (0.02, 0.0), (0.02, 0.03)):
        problem = replace(GIVEN, experiment=experiment, fit=replace(GIVEN.fit, weights=WeightSpec(floor, "diagonal")))
        plan, x = problem.plan(experiment), problem.parameters.x
        prospect, (configuration,) = replace(problem.prospect(plan, 0), distortion=distortion), plan.configurations
        H, source = prospect.information(configuration, x), prospect.source(configuration, x)
        torque = closed_loop_of(TWO, controller, plan.rate_hz)(configuration, plan.freq_hz).torque
        np.testing.assert_allclose(source.spread, np.abs(np.linalg.inv(torque)) ** 2)
        power = np.sum(np.abs(prospect.R[0]) ** 2, axis=0)
        np.testing.assert_allclose(source.information(power), H, atol=1e-9 * H.max())
        single = replace(prospect, plan=replace(plan, R=plan.R[:, :, :1])).information(configuration, x)
        assert (np.abs(2 * single - H).max() < 1e-9 * H.max()) == (floor == 0)
        largest.append(H.max())
    assert largest[0] > largest[1] > largest[2]


def test_candidates_that_tip_over_are_no_choice() -> None:
    """Under gravity, on soft springs."""
    hanging = with_joints(replace(TWO, gravity=(0, -9.81, 0)), lambda joint: replace(joint, spring=Spring(15.0, 0.1)))
    up, down = {"up": (math.pi / 2, 0.2)}, {"down": (-math.pi / 2, 0.2)}
    problem = replace(_with(count=1, candidates=CandidateSpec(given=up | down)), robot=hanging)
    assert [c.name for c in design(problem).plan.configurations] == ["down"]
    problem = replace(_with(count=1, candidates=CandidateSpec(given=up)), robot=hanging)
    with refused("robot/no-equilibrium"):
        design(replace(problem, experiment=replace(problem.experiment, configurations=down)))


def test_design_adds_configurations_and_beats_random_choice() -> None:
    """Names, realisations, robot time, and the geometric mean of the forecasts of random plans."""
    problem = replace(PROBLEM, experiment=replace(PROBLEM.experiment, configurations={"c1": (0.0, 0.5)}))
    found = design(problem)
    names = [c.name for c in found.plan.configurations]
    assert names == [f"c{i + 1}" for i in range(len(names))]
    assert sum(found.plan.realisations) == 2 * (1 + 3)
    assert found.plan.robot_time_s == 8 * 2 * 3 * 1.0
    assert "chosen among" in found.forecast.choice

    def level(angles: np.ndarray) -> float:
        given = {"c1": (0.0, 0.5), **{f"r{i}": (float(a), float(b)) for i, (a, b) in enumerate(angles)}}
        plain = replace(problem, design=None, experiment=replace(problem.experiment, configurations=given))
        return float(np.linalg.slogdet(design(plain).forecast.covariance)[1])

    draw = np.random.default_rng(0)
    planned = float(np.linalg.slogdet(found.forecast.covariance)[1])
    assert planned < min(level(draw.uniform(-1.9, 1.9, (3, 2))) for _ in range(5))


def test_robot_time_is_filled() -> None:
    """With one candidate of two periods and a transient, 3 s each and two realisations of two experiments."""
    one = CandidateSpec(given={"a": (0.1, 0.9)})
    assert design(_with(count=None, robot_time=40.0, candidates=one)).plan.robot_time_s == 36.0
    with refused("design/limits", place="design.robot_time"):
        design(_with(count=None, robot_time=10.0))


def test_what_a_plan_cannot_see_is_named_with_its_direction() -> None:
    """Without gravity m c^2 + I of the fore arm is all that counts in one configuration: two of its numbers are one."""
    fit = FitSpec(parameters={"k_2": ParameterSpec(), "I_upper": ParameterSpec(), "m_upper": ParameterSpec()})
    problem = replace(
        PROBLEM, design=None, fit=fit, experiment=replace(PROBLEM.experiment, configurations={"a": (0.0, 0.5)})
    )
    forecasted = design(problem).forecast
    seen = dict(zip(forecasted.parameters, np.isfinite(forecasted.std), strict=True))
    assert seen == {"k_2": True, "I_upper": False, "m_upper": False}
    # I changes by dI, m by dm: dI / I * 0.1 + dm / m * 5 * 0.2^2 = 0, so that the ratio is -2.
    (text,) = (note.text for note in forecasted.notes if note.code == "fit/not-identifiable")
    assert "the combination +0.89 I_upper -0.45 m_upper (relative changes)" in text


@pytest.mark.parametrize(
    ("problem", "code"),
    [
        (_with(count=90), "design/candidates"),
        (replace(PROBLEM, excitation=replace(PROBLEM.excitation, band_hz=(3.0, 6.0))), "excitation/power"),
        (
            replace(
                PROBLEM, design=None, excitation=replace(PROBLEM.excitation, torque_rms=1e-9),
                experiment=replace(PROBLEM.experiment, configurations={"a": (0.1, 0.2)}),
            ),
            "excitation/power",
        ),
        (_with(parameters=("k_9",)), "design/goal"),
        (_with(parameters=("c_*",)), "design/goal"),
        (replace(_with(parameters=("c_*",)), fit=FitSpec(
            parameters={"k_*": ParameterSpec(), "c_fore_z": ParameterSpec()})), "design/goal"),
    ],
)  # fmt: skip
def test_what_cannot_be_designed_is_refused_with_what_would_fit(problem: DesignProblem, code: str) -> None:
    with refused(code):
        design(problem)


def _rough(problem: DesignProblem, coulomb: float) -> DesignProblem:
    """With Coulomb friction of so many Nm at both motors, link side."""
    rough = with_joints(problem.robot, lambda j: replace(j, motor=j.motor and replace(j.motor, coulomb=coulomb / 30)))
    return replace(problem, robot=rough)


@pytest.mark.parametrize(("realisations", "is_left"), [(1, True), (2, False)])
def test_compensated_friction_hardly_changes_forecast(realisations: int, is_left: bool) -> None:
    """With estimator.friction the forecast is near that of a robot without, where realisations show friction."""
    problem = replace(GIVEN, experiment=replace(GIVEN.experiment, realisations=realisations))
    smooth, left = design(problem).forecast, design(_rough(problem, 0.3)).forecast
    taken = design(replace(_rough(problem, 0.3), friction="coulomb")).forecast
    assert np.all(left.relative > 1.5 * smooth.relative)
    expected = left.relative if is_left else smooth.relative
    np.testing.assert_allclose(taken.relative, expected, rtol=1e-9 if is_left else 0.05)
    assert np.all(taken.relative > smooth.relative)


@pytest.mark.parametrize(("coulomb", "motors"), [(0.65, 0), (0.7, 1), (1.6, 1), (1.7, 2)])
def test_coulomb_friction_above_third_of_torque_is_reported(coulomb: float, motors: int) -> None:
    """On the link side, of 5 and 2 Nm rms behind gears, in two realisations."""
    plan, robot = make_plan(GIVEN.excitation, GIVEN.experiment, TWO, 0), _rough(GIVEN, coulomb).robot
    places = ["motor 1", "motor 2"][2 - motors :]
    assert [(note.code, note.place) for note in sticking_notes(plan, robot, None)] == [
        ("design/motor-sticks", place) for place in places
    ]
    assert not sticking_notes(plan, robot, CarrierSpec(amplitude=0.1))


@pytest.mark.parametrize(("ratio", "is_noted"), [(0.1, False), (0.3, True), (3.0, True), (6.0, False)])
def test_motors_that_reverse_within_their_presliding_distance_are_reported(ratio: float, is_noted: bool) -> None:
    """Distances between reversals as in the rehearsed log, on the link side; bristles of 0.1 Nm at motor 2."""
    plan = make_plan(GIVEN.excitation, GIVEN.experiment, TWO, 0)
    fitted = GIVEN.fit_measurements(plan)
    rig = SimulatedRig(GIVEN.robot, replace(GIVEN.experiment, simulated=SimulatedSpec()), plan, 0)
    ways = [np.diff(rig.measure(run).y[rig.measure(run).period_samples :], axis=0) for run in plan.experiments]
    path = np.sum([np.abs(way).sum(axis=0) for way in ways], axis=0)
    turns = np.sum([(np.diff(np.sign(way), axis=0) != 0).sum(axis=0) for way in ways], axis=0)
    ((prospect, configuration),) = fitted
    distance, speed, travel = prospect.reversals(configuration, prospect.parameters.x)
    np.testing.assert_allclose(distance, path / turns, rtol=0.05)
    np.testing.assert_allclose(travel, np.max([np.ptp(rig.measure(run).y, axis=0) for run in plan.experiments], 0), 0.1)
    rows = [row for row in presliding(fitted, _bent(0.1, ratio, distance)) if row.place == "motor 2"]
    assert len(rows) == is_noted
    for row in rows:
        assert row.unit == "N*m/rad"
        assert row.amplitude == pytest.approx(ratio)
        assert row.rate == pytest.approx(speed[1] * ratio / distance[1])


def _bent(coulomb: float, ratio: float, distance: FloatArray) -> Robot:
    """With bristles of so many Nm at both motors, which bend by `distance` (rad, link side) over `ratio`."""
    laws = {str(i + 1): LuGre(coulomb * ratio / bending / 30**2) for i, bending in enumerate(distance.tolist())}
    friction = {name: Friction(coulomb / 30, lugre=law) for name, law in laws.items()}
    return with_joints(TWO, lambda j: replace(j, motor=j.motor and replace(j.motor, friction=friction[j.name])))


def test_presliding_friction_and_tolerances_of_gears_widen_the_forecast() -> None:
    """Two numbers more at each motor, against Coulomb's law without presliding; and ratios against exact ones."""
    problem = replace(GIVEN, friction="auto", experiment=replace(GIVEN.experiment, realisations=2))
    ((prospect, configuration),) = problem.fit_measurements(make_plan(problem.excitation, problem.experiment, TWO, 0))
    distance = prospect.reversals(configuration, prospect.parameters.x)[0]
    rigid = design(_rough(problem, 0.6)).forecast
    designed = design(replace(problem, robot=_bent(0.6, 3.0, distance)))
    assert np.all(designed.forecast.relative > [1.1, 1.2, 1.0, 1.0] * rigid.relative)
    assert [note.code for note in designed.forecast.notes] == ["design/presliding"] * 2
    ratios, exact = (
        design(replace(GIVEN, robot=replace(TWO, tolerances=Tolerances(ratio=ratio)))).forecast
        for ratio in (0.003, EXACT)
    )
    assert np.all(ratios.relative[[0, 2]] > 1.3 * exact.relative[[0, 2]])


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.5, 1.0])
def test_fits_with_presliding_friction_state_the_std_of_the_forecast(ratio: float) -> None:
    """A third of the torque is friction; predicted over stated standard deviation of k is 0.7 to 1.4."""
    postures = {"a": (0.3, 0.8), "b": (0, 1.8), "c": (-1, -0.4)}
    quiet = SimulatedSpec(noise=NoiseSpec(torque_std=0.03, angle_std=1e-6), substeps=8)
    experiment = ExperimentSpec(postures, 2, ramp=0.0, simulated=quiet)
    problem = replace(
        PROBLEM, design=None, friction="auto", experiment=experiment, fit=replace(PROBLEM.fit, weights=WeightSpec())
    )
    fitted = problem.fit_measurements(make_plan(problem.excitation, problem.experiment, TWO, 0))
    distance = np.median([model.reversals(c, model.parameters.x)[0] for model, c in fitted], axis=0)
    bent = replace(problem, robot=replace(_bent(0.6, ratio, distance), tolerances=Tolerances()))
    designed = design(bent)
    result = fit_parameters(_measured(bent, designed.plan, 1), replace(TWO, tolerances=Tolerances()), bent.fit)
    for name, std in zip(designed.forecast.parameters, designed.forecast.std, strict=True):
        if name.startswith("k"):
            assert 0.7 < std / result.std[name] < 1.4, (name, std / result.std[name])


@pytest.mark.slow
def test_a_study_without_configurations_runs_on_those_chosen(tiny: Path, tmp_path: Path) -> None:
    """Two of thirty candidates, from the plan to the page."""
    tiny.write_text(tiny.read_text().replace("  configurations:\n    a: [0]\n    b: [30 deg]\n", ""))
    done = elastid.run(tiny, tmp_path / "run", set=["design={count: 2, candidates: {random: 30}}"])
    assert len(done.responses) == 2
    assert done.result.status == "converged"
    assert done.report.is_file()
