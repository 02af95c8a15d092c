"""Words of the field are found where keys and results have them in their texts."""

import pytest

from elastid.app.cli import run_command
from elastid.study.words import explain_word


def test_a_word_is_found_in_keys_and_results(capsys: pytest.CaptureFixture[str]) -> None:
    assert "frf.h5 quality/coherence: " in explain_word("coherence")
    assert "experiment.realisations" in explain_word("realisations")
    assert explain_word("zebra") == ""
    assert run_command(["explain", "Coherence"]) == 0
    assert "multiple_coherence" in capsys.readouterr().out
    assert run_command(["explain", "zebra"]) == 2
    assert "a study has no key zebra" in capsys.readouterr().err
