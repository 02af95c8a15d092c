"""The arm about two postures, as a controller of 250 Hz sees it."""

import numpy as np
import pytest
from plants.arm import result

from elastid.record import Configuration
from elastid.use.plants import PostureFamily

RATE_HZ = 250.0
POSTURES = (Configuration("a", np.array([0.3, 0.5])), Configuration("b", np.array([0.5, -1.2])))


@pytest.fixture(scope="session")
def family() -> PostureFamily:
    return PostureFamily.of(result(), POSTURES, RATE_HZ)
