"""A fit whose model is wrong does not end as converged, a fit whose model is true does; bounds are named."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from plants.elastic_arm import measure, pendulum
from plants.faults import SPEC, drawn, faulty, rubbing, true_case

from elastid.fit.diagnosis.status import bound_notes
from elastid.fit.identify import fit_parameters, identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.parameters import Parameters


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


def test_each_number_has_a_verdict_and_the_status_is_that_of_what_is_wanted() -> None:
    """Gear ratios 1 % off turn the gears' springs, and leave that of the first link alone: a study of it converges."""
    case = faulty("gear ratio 1 % wrong")
    data = drawn(case, np.random.default_rng(0))
    result = fit_parameters(data, case.robot, SPEC)
    verdicts = dict(zip((p.name for p in result.parameters.asked), result.verdicts, strict=True))
    assert result.status == "misfit"
    assert verdicts["k_1"] != verdicts["k_1x"] == "good"
    assert abs(np.log(result.values["k_1x"] / case.stiffness["k_1x"])) < 3 * result.std["k_1x"] / result.values["k_1x"]
    of_the_link = fit_parameters(data, case.robot, replace(SPEC, focus=("k_1x",)))
    assert of_the_link.status == "converged"
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
