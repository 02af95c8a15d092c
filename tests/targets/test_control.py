"""python-control, given what is exported to it, has the response of the linear model."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from plants.fitted_models import DELAY, close, responses_of

from elastid.fit.fitted_robot import FittedRobot
from elastid.targets.control import write_control


def test_python_control_reads_the_response_back(model: FittedRobot, tmp_path: Path) -> None:
    """State space by the loader, times the delay; within 1e-7 without loops, 1e-6 with them."""
    _, script = write_control(tmp_path, model)
    specification = importlib.util.spec_from_file_location("load_model", script)
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    systems, delays = module.load()
    for i, name in enumerate(("one", "two")):
        assert tuple(systems[name].input_labels) == model.linear[i].inputs
        assert delays[name] == pytest.approx(0.0 if model.robot.loops else DELAY)
        f = model.measured[i].freq_hz
        G = np.moveaxis(np.asarray(systems[name](2j * np.pi * f, squeeze=False)), 2, 0)
        delayed = G * np.exp(-2j * np.pi * f * delays[name])[:, None, None]
        assert close(delayed, responses_of(model, i), 1e-6 if model.robot.loops else 1e-7)
        late = module.load(pade=4)[0][name]
        slow = f < 30
        G = np.moveaxis(np.asarray(late(2j * np.pi * f[slow], squeeze=False)), 2, 0)
        assert close(G, responses_of(model, i)[slow], 1e-6)
        assert np.array_equal(np.moveaxis(module.measured()[name].frdata, 2, 0), model.measured[i].G)
