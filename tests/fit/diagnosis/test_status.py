"""A fit whose model is wrong does not end as converged, a fit whose model is true does; bounds are named."""

import re
from dataclasses import replace
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from plants.data_sheet_arm import SPEC as OF_SHEET
from plants.data_sheet_arm import arm as sheet
from plants.data_sheet_arm import measure as sheet_responses
from plants.elastic_arm import measure, pendulum
from plants.faults import SPEC, drawn, faulty, rubbing, true_case
from plants.measured_robots import responses_of

from elastid.fit.diagnosis.estimate_notes import bound_notes
from elastid.fit.diagnosis.priors import contradicted_tolerances, relative_change, scattered_ratios
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec, WeightSpec
from elastid.parameters import Parameters
from elastid.report.next_steps import next_steps
from elastid.report.parameter_row import parameter_rows
from elastid.report.run_summary import residual_sentence
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Robot, Spring, Tolerances


@pytest.mark.slow
@pytest.mark.parametrize("spec", [SPEC, replace(SPEC, weights=WeightSpec())], ids=["noise alone", "floor of 1 %"])
def test_a_true_robot_converges_with_and_without_friction(spec: FitSpec) -> None:
    """Noise whose variance has 3 or 8 degrees of freedom, and the distortion of friction that its covariance knows."""
    case = true_case()
    for seed, dof in product(range(3), (3.0, 8.0)):
        rough = rubbing(case, np.random.default_rng(seed), dof=dof)
        for data in (drawn(case, np.random.default_rng(seed), 0.01, dof), rough):
            assert fit_parameters(data, case.robot, spec).status == "converged"


def test_one_line_beyond_the_noise_is_no_misfit() -> None:
    """A line 100 standard deviations off makes V too large, and no parameter wrong."""
    case = true_case()
    data = drawn(case, np.random.default_rng(0))
    first = data[0]
    one = np.zeros(first.G.shape)
    one[30, 0, 0] = 100.0
    spoilt = (replace(first, G=first.G + one * np.sqrt(first.total.variance)), *data[1:])
    result = fit_parameters(spoilt, case.robot, SPEC)
    assert result.exceeds_noise
    assert result.inflation_factor > 1.5
    assert result.status == "converged"


def test_numbers_have_verdicts_and_status_follows_focus() -> None:
    """Gear ratios 1 % off turn the gears' springs, and leave that of the first link alone: a study of it converges."""
    case = faulty("gear ratio 1 % wrong")
    data = drawn(case, np.random.default_rng(0))
    result = fit_parameters(data, case.robot, SPEC)
    verdicts = dict(zip((p.name for p in result.parameters.of_interest), result.verdicts, strict=True))
    assert result.status == "misfit"
    assert verdicts["k_1"] != verdicts["k_1x"] == "good"
    assert abs(np.log(result.values["k_1x"] / case.stiffness["k_1x"])) < 3 * result.std["k_1x"] / result.values["k_1x"]
    assert fit_parameters(data, case.robot, replace(SPEC, focus=("k_1x",))).status == "converged"
    case = true_case()
    true = fit_parameters(drawn(case, np.random.default_rng(0)), case.robot, SPEC)
    assert true.verdicts == ("good",) * len(verdicts)


def test_an_estimate_at_its_bound_says_so():
    """Bounds that keep the truth out: a misfit that ends there."""
    spec = FitSpec(parameters={"k_1": ParameterSpec(start=50.0, bounds=(40.0, 95.0)), "d_1": ParameterSpec()}, starts=3)
    result = identify(measure(pendulum(), [(0.0,)]), pendulum(), spec)
    assert result.status == "misfit"
    np.testing.assert_array_equal(result.at_bound, [True, False])
    assert "fit/at-bound" in {note.code for note in result.notes}
    assert result.inflation_factor > 1.5
    of_file = Parameters(tuple(replace(parameter, is_nuisance=True) for parameter in result.parameters))
    assert len([*bound_notes(replace(result, parameters=of_file))]) == 1


FILE = sheet(Tolerances())


def measured(true: Robot = FILE) -> list[Response]:
    return sheet_responses(true, np.random.default_rng(5))


def test_a_file_beyond_its_tolerances_is_a_misfit_everywhere() -> None:
    """A motor inertia 9.4 tolerances off, at residuals of the noise; its advice is no contradiction."""
    responses = measured(FILE.with_parameters({"Jm_2": 1.6e-3}))
    result = identify(responses, FILE, OF_SHEET)
    assert (result.status, result.exceeds_noise) == ("misfit", False)
    for text in (result.message, residual_sentence(result, ()), result.cause.text):
        assert re.search(r"Jm_2 = 0\.0016 .* 5\.0 %", text)
    (advised,) = next_steps(result, parameter_rows(result, None))
    for std, status in ((0.05, "misfit"), (float(re.findall(r"std: (.*)}}", advised.text)[0]), "converged")):
        freed = OF_SHEET.parameters | {"Jm_2": ParameterSpec(prior=PriorSpec(std=std))}
        again = identify(responses, FILE, replace(OF_SHEET, parameters=freed))
        said = ("fit/prior-contradicted", "Jm_2") in {(note.code, note.place) for note in again.notes}
        assert (again.status, said) == (status, status == "misfit")


@pytest.mark.parametrize(("factor", "changes"), [(1.0, []), (1.2, [-17])])
def test_what_the_tolerances_absorb_together_is_said_with_its_size(factor: float, changes: list[float]) -> None:
    """Torque constants 20 % off: no number beyond 5 tolerances, all stiffnesses 20 % off, as an exact file has them."""
    result = identify([replace(G, G=G.G / factor) for G in measured()], FILE, OF_SHEET)
    notes = [note for note in result.notes if note.code == "fit/tolerances"]
    found = [float(re.findall(rf"{note.place} by (.\d+) %", note.text)[0]) for note in notes]
    assert found == pytest.approx(changes, abs=2)
    assert result.status == ("misfit" if changes else "converged")


@pytest.mark.parametrize(("std", "is_beyond"), [(2.0, False), (4.6, True)])
def test_combined_tolerance_shift_of_stiffness_is_detected(std: float, is_beyond: bool) -> None:
    """Each number off its file by what moves k_2 most: at 4.6 std none by 4 tolerances, their rms by chance."""
    true = identify(measured(), FILE, OF_SHEET)
    n, C = len(true.parameters.of_interest), true.covariance
    free = true.parameters.free[n:]
    s = np.array([p.prior.std for p in free])
    pull = s * np.linalg.solve(C[n:, n:], C[n:, true.parameters.free_names.index("k_2")])
    d = dict(zip((p.name for p in free), std * s * pull / np.linalg.norm(pull), strict=True))
    moved = {p.name: p.value * np.exp(d[p.name]) if p.log else p.value + d[p.name] for p in free}
    numbers = {name: value for name, value in moved.items() if name in {*FILE.numbers, *FILE.geometry}}
    result = identify(measured(FILE.with_parameters(numbers)), FILE, OF_SHEET)
    assert [note.place for note in result.notes if note.code == "fit/tolerances"] == ["k_2"] * is_beyond


def test_numbers_moved_by_ratios_count_once() -> None:
    """All 1.3 tolerances off, with variances of 26 tolerances squared by scattering ratios: within chance."""
    true = identify(measured(), FILE, OF_SHEET)
    n, s = (
        len(true.parameters.of_interest),
        np.array([p.prior.std for p in true.parameters.free[len(true.parameters.of_interest) :]]),
    )
    x, C = true.x.copy(), true.covariance.copy()
    x[n:] += 1.3 * s * np.resize([1, -1], len(s))
    C[n:, n:] += 25 * np.diag(s**2)
    assert not contradicted_tolerances(replace(true, x=x, covariance=C))


def test_motors_exchanged_in_one_configuration_are_named_with_it() -> None:
    first, *others = measured()
    first = identify([replace(first, G=first.G[:, ::-1, ::-1]), *others], FILE, OF_SHEET).indices[0]
    assert {*re.findall(r"motor \d|c\d", first.name)} == {"motor 1", "motor 2", "c0"}


def test_torque_constant_is_remedy_for_its_interval() -> None:
    """A joint whose inertias are sought: 5 % of its torque constant are +-9.8 % of all, which noise alone is not."""
    joint = Joint("1", spring=Spring(64.0, damping=0.014), motor=Motor(1.2e-3, viscous=2e-3))
    load, known = Body("load", joints=(joint,), inertia=8e-4), Tolerances(torque_constant=0.05)
    robot = Robot("bench", (load,), gravity=(0, 0, 0), tolerances=known)
    responses = responses_of(robot, {"c": (0.0,)}, np.random.default_rng(5), np.linspace(5, 100, 40), 0.01, 0.0)
    names = ("k_1", "d_1", "Jm_1", "I_load", "fm_1")
    result = identify(responses, robot, FitSpec(parameters={name: ParameterSpec() for name in names}, starts=1))
    action = next_steps(result, parameter_rows(result, None))[0]
    assert "gain_u_motor_1" in action.sentence
    ((name, before, after),) = re.findall(r"of (\w+)\..* ±(\S+) % .*±(\S+) %", action.gain)
    assert float(before) > 9.0
    assert float(after) == pytest.approx(196 * result.std_noise[name] / result.values[name], rel=0.1)


@pytest.mark.parametrize(("step", "words"), [(0.1, "%"), (-2.0, "factor 0.135"), (2000.0, "1e+06"), (-2000.0, "1e-06")])
def test_changes_of_any_size_have_a_size(step: float, words: str) -> None:
    """A model that is wrong without measure extrapolates steps beyond the range of numbers."""
    assert words in relative_change(step)


@pytest.mark.parametrize("explains", [True, False])
def test_scatter_of_gear_ratios_is_stated_with_its_tolerance(explains: bool) -> None:
    """Three times the tolerance of 0.1 %, only for a motor with this scatter, and only if it explains the misfit."""
    response = SimpleNamespace(inputs=("motor 1", "motor 2"), ratio_std=np.array([5e-3, 1e-3]))
    notes = scattered_ratios(SimpleNamespace(std={"motor 2": 3.0}, explains=explains), [response])
    assert [re.findall(r"([\d.]+) %", note.text) for note in notes] == explains * [["0.3", "0.1"]]
