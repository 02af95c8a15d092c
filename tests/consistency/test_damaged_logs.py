"""Whole studies of a two-axis arm whose logs are damaged: results as of the clean logs."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import elastid

RIG = Path(__file__).parents[3] / "shared" / "rigs" / "two_axis_arm.py"


@pytest.mark.slow
@pytest.mark.skipif(not RIG.is_file(), reason="the simulator ../shared/rigs/two_axis_arm.py is not there")
@pytest.mark.filterwarnings("default")
def test_five_damaged_samples_a_channel_change_no_result(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Missing, zero and spikes: stiffness, damping, friction within 0.3 std, stated at most 1.2 times as wide."""
    monkeypatch.syspath_prepend(str(RIG.parent))
    rig, rng, results = import_module(RIG.stem), np.random.default_rng(0), {}
    clean = rig.dataset(seed=5000, M=3, fc1=9.6, fc2=4.8)
    for kind in ("clean", "missing", "zero", "spike"):
        logs = {key: {name: x.copy() for name, x in log.items()} for key, log in clean.items()}
        for log in logs.values() if kind != "clean" else ():
            for x in (log[name][:, c] for name in ("u", "q") for c in (0, 1)):
                # No two periods at one phase: of three, none then shows which is right.
                at = rng.choice(np.arange(20, 980), 5, replace=False) + 1000 * rng.integers(0, 3, 5)
                spikes = x[at] + x.std() * rng.uniform(2, 20, 5)
                x[at] = {"missing": np.full(5, np.nan), "zero": np.zeros(5), "spike": spikes}[kind]
        rig.write(logs, str(tmp_path / kind))
        done = elastid.run(tmp_path / kind / "study.yml", tmp_path / kind / "run")
        assert done.result.status == "converged"
        results[kind] = done.result
    reference = {name: results["clean"][name] for name in ("k_1", "k_2", "d_1", "d_2", "fm_1", "fm_2")}
    for kind in ("missing", "zero", "spike"):
        for name, number in reference.items():
            assert abs(results[kind][name].value - number.value) < 0.3 * number.std, (kind, name)
            assert results[kind][name].std < 1.2 * number.std, (kind, name)
