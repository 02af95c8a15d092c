"""A study small enough to be run many times: one elastic joint, simulated in a second."""

import gc
import os
import signal
from collections.abc import Callable, Collection, Iterator
from functools import cache, lru_cache
from pathlib import Path

import pytest
from hypothesis import settings

from elastid.app.cli import one_blas_thread
from elastid.model.elastic import ElasticModel

one_blas_thread()  # before NumPy is loaded: two workers with two threads each would wait for each other

from elastid.app import run as work  # noqa: E402
from elastid.model import formulation  # noqa: E402

# The same examples in every run of the same code; .ci/nightly draws others with the profile `default`.
settings.register_profile("repeatable", derandomize=True)
settings.load_profile("repeatable")

TINY_ROBOT = """\
name: one elastic joint
gravity: [0, 0, 0]
bodies:
  - name: load
    joints:
      - name: 1
        axis: z
        motor: {inertia: 1e-3, ratio: 1, viscous: 1e-3}
        spring: {stiffness: 50, damping: 0.01}
        limits: {angle: [-90 deg, 90 deg]}
    inertia: 1e-3
"""
TINY_STUDY = """\
name: tiny
robot: robot.yml
seed: 1
excitation:
  rate_hz: 500
  period: 1 s
  band_hz: [5, 100]
  torque_rms: 0.1
experiment:
  configurations:
    a: [0]
    b: [30 deg]
  simulated:
    truth: {k_1: 60 N*m/rad}
    noise: {torque_std: 1e-3, angle_std: 1e-6}
fit:
  starts: 2
  parameters:
    k_1: {}
    d_1: {}
report: {formats: []}
"""


def pytest_configure(config: pytest.Config) -> None:
    """One core for each of pytest's workers: what a command starts on all cores that it may use is one process."""
    worker = getattr(config, "workerinput", {}).get("workerid", "")
    if worker and hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {cores[int(worker.removeprefix("gw")) % len(cores)]})


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests in a browser slow, and mark modules that use records beside the project: .ci/run selects both."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("slow")
        names = vars(getattr(item, "module", None) or object)
        if any(getattr(value, "__module__", "") == "plants.measured" for value in names.values()):
            item.add_marker("beside")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Modules and tests are never garbage: the collector, which looked at them in 8 % of the time, leaves them out."""
    gc.freeze()
    gc.set_threshold(100_000, 20, 100)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test with the mark `oracle(module)` if that independent implementation is not installed."""
    for mark in item.iter_markers("oracle"):
        for name in mark.args:
            pytest.importorskip(name, reason=f"{name} is in the group oracles")


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Ctrl-C as on a terminal; what runs in the background of a shell begins with it ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(autouse=True, scope="session")
def code_hashed_once() -> Iterator[None]:
    """The package does not change while it is tested: its hash is taken once, not for each run of a study."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "code_hash", cache(work.code_hash))
        yield


@pytest.fixture(autouse=True, scope="session")
def equations_derived_once() -> Iterator[None]:
    """Models of equal robots are equal and do not change: many tests have the same robot."""

    def once(derive: Callable[..., ElasticModel]) -> Callable[..., ElasticModel]:
        derived = lru_cache(64)(derive)
        return lambda robot, *rest: derived(robot, *(tuple(e) if isinstance(e, Collection) else e for e in rest))

    with pytest.MonkeyPatch.context() as patch:
        for name in ("serial", "with_constraints", "minimal"):
            patch.setattr(formulation, name, once(getattr(formulation, name)))
        yield


@pytest.fixture
def tiny(tmp_path) -> Path:
    folder = tmp_path / "tiny"
    folder.mkdir()
    (folder / "robot.yml").write_text(TINY_ROBOT)
    (folder / "study.yml").write_text(TINY_STUDY + "estimator: {friction: none}\n")  # there is none
    return folder / "study.yml"


@pytest.fixture(scope="session")
def tiny_texts() -> tuple[str, str]:
    """The texts of the study and of its robot."""
    return TINY_STUDY, TINY_ROBOT
