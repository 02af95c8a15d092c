"""Rows of the parameter table: deviations from the truth in standard deviations."""

from __future__ import annotations

import math

import pytest
from plants.report_values import fit_result

from elastid.parameters import Parameter, ParameterSet
from elastid.report.parameter_rows import parameter_rows


def test_rows_say_how_many_standard_deviations_the_estimate_is_from_the_truth():
    """In the solver's variable: ln p for a logarithmic parameter, p for a linear one; none without a truth."""
    rows = parameter_rows(fit_result(), {"k_1": 3e5, "x_c": -0.02})
    assert rows[0].deviation == pytest.approx(math.log(3.02 / 3) / 0.01)
    assert rows[1].deviation is None
    assert rows[3].deviation == pytest.approx(0.005 / 0.004)


def test_a_parameter_of_one_configuration_has_the_truth_of_the_one_it_stands_for():
    """Unless it has a truth of its own."""
    warm = Parameter("k_1@warm", 2e5, log=True, only=("warm",))
    parameters = ParameterSet((Parameter("k_1", 2e5, free=False), warm))
    result = fit_result(parameters)
    assert parameter_rows(result, {"k_1": 3e5})[0].truth == 3e5
    assert parameter_rows(result, {"k_1": 3e5, "k_1@warm": 2e5})[0].truth == 2e5
