"""Passes under several loads have gravity of their own and one curve of friction."""

from dataclasses import replace

import numpy as np
import pytest
from plants.friction_records import records, template

from elastid.friction_record import FrictionRecord
from elastid.friction_study.levels import levels_of_records

# Growth of Coulomb friction with the load, Nm per Nm.
BY_LOAD = 0.04
SMALL = ("friction.rate_hz=250", "friction.passes.count=5", "friction.passes.repeat=1")


def loaded(record: FrictionRecord, load: float) -> FrictionRecord:
    """The same pass with a further torque of gravity, and friction that grows with it."""
    assert record.velocity is not None
    further = -load * np.sin(record.position) + BY_LOAD * load * np.sign(record.velocity)
    return replace(record, torque=record.torque + further, load=f"{load:g}", load_torque=load)


def test_gravity_of_one_load_is_not_friction_of_another() -> None:
    """Levels grow by what friction does, to its noise, although gravity grows by far more."""
    _, measured = records(template(*SMALL))
    loads = (0.0, 100.0, 200.0)
    found = levels_of_records([loaded(one, load) for load in loads for one in measured.records], True, 0.0)
    levels = found.levels
    n = levels.n_levels // 3
    assert not levels.direction.any()
    for i in (1, 2):
        more = levels.torque[i * n : (i + 1) * n] - levels.torque[:n]
        # The noise of the three is one and the same.
        assert more == pytest.approx(np.full(n, BY_LOAD * loads[i]), abs=0.02)
        assert levels.load[i * n] == loads[i]
