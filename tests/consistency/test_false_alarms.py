"""The study of false alarms: two clean logs raise none, and each threshold that it measures quotes a rate."""

import sys
from dataclasses import fields
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts" / "studies"))
from false_alarms import JUDGEMENTS, interval, judged, quoted, tables


def test_clean_logs_of_both_generators_raise_no_alarm() -> None:
    """Read, estimated, and the first of them fitted."""
    for number in (0, 1):
        assert judged(number, 0, "").codes == {}


def test_every_judgement_is_of_fields_that_exist_and_is_quoted() -> None:
    """The tables are found by themselves; a new one is without a rate until it is in JUDGEMENTS."""
    found = dict(tables())
    assert set(JUDGEMENTS) < set(found)
    for place, judgements in JUDGEMENTS.items():
        assert set(judgements) <= set(quoted(found[place])), place
        names = {field.name for field in fields(found[place])} | {"*"}
        assert {name for text in judgements.values() for name in text.split()} <= names, place


def test_no_alarm_of_300_has_an_interval_up_to_1_2_percent() -> None:
    """1 - 0.025^(1/300)."""
    low, high = interval(0, 300)
    assert (low, round(high, 4)) == (0.0, 0.0122)
