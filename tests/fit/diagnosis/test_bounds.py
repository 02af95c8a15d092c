"""Notes on parameters that ended at a bound."""

from dataclasses import replace

import numpy as np
from plants.elastic_arm import measure, pendulum

from elastid.fit.diagnosis.status import bound_notes
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.parameters import Parameters


def test_an_estimate_at_its_bound_says_so():
    """Bounds that keep the truth out: a misfit that ends there, and the messages name parameter, side and value."""
    spec = FitSpec(parameters={"k_1": ParameterSpec(start=50.0, bounds=(40.0, 95.0)), "d_1": ParameterSpec()}, starts=3)
    result = identify(measure(pendulum(), [(0.0,)]), pendulum(), spec)
    assert result.status == "misfit"
    assert result.message.startswith("with k_1 at a bound the model is wrong")
    np.testing.assert_array_equal(result.at_bound, [True, False])
    assert any(note.code == "fit/at-bound" and "k_1 " in note.text and " 95 " in note.text for note in result.notes)
    assert result.model_error > 1.5
    of_file = Parameters(tuple(replace(parameter, tolerated=True) for parameter in result.parameters))
    assert len([*bound_notes(replace(result, parameters=of_file))]) == 1
