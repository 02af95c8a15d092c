"""The fitted models that are exported, each built once."""

import pytest
from plants.fitted_models import LOOPED, SERIAL, fitted_model

from elastid.fit.fitted_robot import FittedRobot


@pytest.fixture(params=SERIAL)
def serial_model(request) -> FittedRobot:
    return fitted_model(request.param)


@pytest.fixture(params=LOOPED)
def looped_model(request) -> FittedRobot:
    """Of a robot with loops, in one of its formulations."""
    return fitted_model(request.param)


@pytest.fixture(params=[*SERIAL, *LOOPED])
def model(request) -> FittedRobot:
    return fitted_model(request.param)
