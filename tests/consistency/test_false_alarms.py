"""The study of false alarms: two clean logs raise none."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts" / "studies"))
from false_alarms import interval, judged


def test_clean_logs_of_both_generators_raise_no_alarm() -> None:
    """Read, estimated, and the first of them fitted."""
    for number in (0, 1):
        assert judged(number, 0, "").codes == {}


def test_no_alarm_of_300_has_an_interval_up_to_1_2_percent() -> None:
    """1 - 0.025^(1/300)."""
    low, high = interval(0, 300)
    assert (low, round(high, 4)) == (0.0, 0.0122)
