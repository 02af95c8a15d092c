"""A comparison comes back to the last bit, infinite and undefined numbers included, and only for its own responses."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from plants.artefacts import STAMP, same

from elastid.store.results import read_comparison, write_comparison
from elastid.validation.comparison import ComparedModel, Comparison, Trial

MODELS = (
    ComparedModel("own", 3, 1 / 3, 100, 0.0, np.array([0.1, 0.2]), 0.3, 2.0),
    ComparedModel("failed", 0, math.inf, 0, math.inf, np.array([math.nan, 1.0]), math.nan, math.nan, "why"),
)
TRIALS = (
    Trial(1, "free", ("2x",), ("gear 1", "2x"), 4, 2.0, 1.0, -1.0, 0.1, -5.0, True),
    Trial(2, "rigid", ("gear 1",), ("2x",), 3, 1.0, math.inf, math.nan, math.inf, math.nan, False),
)


@pytest.mark.parametrize("trials", [(), TRIALS])
def test_a_comparison_comes_back_to_the_last_bit(tmp_path, trials):
    """With a search and without."""
    written = Comparison(("a", "b"), MODELS, "own predicts best.", trials)
    write_comparison(tmp_path / "compare.json", written, replace(STAMP, software="elastid 0.1.0, Python 3.11"))
    assert same(read_comparison(tmp_path / "compare.json", STAMP), written)
    content = json.loads((tmp_path / "compare.json").read_text())
    assert (content["schema"], content["made by"]) == (1, "elastid 0.1.0, Python 3.11")


def test_a_comparison_of_other_responses_or_a_damaged_one_is_not_there(tmp_path):
    """Nor is a missing file."""
    path = tmp_path / "compare.json"
    assert read_comparison(path, STAMP) is None
    write_comparison(path, Comparison(("a", "b"), MODELS, ""), STAMP)
    assert read_comparison(path, replace(STAMP, inputs="other")) is None
    assert read_comparison(path, replace(STAMP, code="other")) is not None
    for text in ("", "[]", "{}", '{"schema": 0}'):
        path.write_text(text)
        assert read_comparison(path, STAMP) is None
