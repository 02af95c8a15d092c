"""The content of a report, made up: responses, a fit, a plan, modes, replays."""

from collections.abc import Collection
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note
from elastid.experiment.plan.plan import Plan
from elastid.fit.problem.least_squares import LocalOptimum
from elastid.fit.result import Result
from elastid.parameters import Parameter, Parameters, Tie
from elastid.record import Configuration
from elastid.report.content import ReportContent
from elastid.report.figures.drawings import drawings
from elastid.report.modes import ModeRow
from elastid.report.page.page import html, write_page
from elastid.response import Covariance, Response
from elastid.validation.frf_error import validate
from elastid.validation.log_comparison import DRY, INERTIA, TorqueBalance
from elastid.validation.torque_balance import torque_balance
from plants.arm_modes import mode_row
from plants.two_mass import circular

FREQ_HZ = np.arange(2.1, 60.0, 0.8)


def chain(n_u, n_y=None, stiffness=3e5, freq_hz=FREQ_HZ):
    """Acceleration (F, n_y, n_u) of the first n_y masses of a chain of n_u motors and as many links."""
    eye = np.eye(n_u)
    springs = np.block([[eye, -eye], [0 * eye[1:], eye[:-1] - eye[1:]]])
    stretch = springs.T @ springs
    M, D = np.diag(np.repeat([30.0, 25.0], n_u)), 20.0 * np.eye(2 * n_u) + 500 * stretch
    s = 2j * np.pi * freq_hz[:, None, None]
    return (s**2 * np.linalg.inv(M * s**2 + D * s + stiffness * stretch))[:, : n_y or n_u, :n_u]


def pair(n_u, n_y=None, name="c1", seed=0, freq_hz=FREQ_HZ):
    """A measured response with noise and total covariance, and a model that is a little off."""
    rng = np.random.default_rng(seed)
    G, model = (chain(n_u, n_y, stiffness, freq_hz) for stiffness in (3e5, 3.03e5))
    noise, total = np.full(G.shape, 4e-8), 4e-8 + (0.03 * np.abs(G)) ** 2
    Ghat = G + np.sqrt(total) * circular(rng, G.shape)
    inputs = tuple(f"motor {i + 1}" for i in range(n_u))
    outputs = tuple(f"place {i + 1}" for i in range(G.shape[1]))
    common = (inputs, outputs, "acceleration", Configuration(name, np.radians([10.0] * n_u)))
    covariances, notes = (Covariance(noise, 11), Covariance(total, 9)), (Note("a-note", f"a note on {name}"),)
    return Response(freq_hz, Ghat, *common, *covariances, notes=notes), Response(freq_hz, model, *common)


PARAMETERS = Parameters(
    (
        Parameter("k_1", 2e5, "N*m/rad", 1e3, 1e7, log=True),
        Parameter("k_2", 4e5, "N*m/rad", 1e3, 1e7, log=True),
        Parameter("d_1", 300.0, "N*m*s/rad", 250.0, 1e5, log=True),
        Parameter("x_c", 0.1, "m", -1.0, 1.0),
        Parameter("d_2", 300.0, "N*m*s/rad", log=True, tie=Tie("d_1", 2.0)),
        Parameter("mass", 25.0, "kg", free=False),
    )
)


TRUTH = {"k_1": 3e5, "k_2": 3.1e5, "d_1": 400.0, "x_c": -0.02}


def fit_result():
    x, std, r = np.array([*np.log([3.02e5, 3e5, 250.0]), -0.015]), np.array([0.01, 0.02, 0.2, 0.004]), np.eye(4)
    r[0, 1] = r[1, 0] = -0.97
    costs = (210.0, 210.0, 210.1, 900.0, 2000.0)
    return Result(
        parameters=PARAMETERS,
        x=x,
        covariance=r * np.outer(std, std),
        cost=210.0,
        dof=200,
        cost_expected=202.0,
        cost_dof=200.0,
        status="at_bound",
        message="The fit ended with d_1 at its lower bound.",
        starts=tuple(LocalOptimum(PARAMETERS.x, x, cost, 20, cost < 1000, "") for cost in costs),
        n_converged_starts=3,
        at_bound=np.arange(4) == 2,
        singular_values=np.array([2.0, 1.0, 0.5, 0.01]),
        criterion="complex",
        notes=(Note("fit/at-bound", "d_1 is at its lower bound of 250 N*m*s/rad"),),
    )


def plan(n_u=3):
    rng = np.random.default_rng(0)
    lines = np.arange(5, 150, 2)
    R = 30 * np.exp(2j * np.pi * rng.random((1, 2, n_u, len(lines), n_u)))
    inputs = tuple(f"motor {i + 1}" for i in range(n_u))
    return Plan((Configuration("c1", np.zeros(n_u)),), inputs, 250.0, 500, 2, 1, lines, R)


def report_content(**changes):
    frf = (pair(2, name="c1"), pair(2, name="c2", seed=1))
    content = ReportContent(
        title="A study",
        verdict="Every stiffness is within 3 % of the truth.",
        result=fit_result(),
        frf=frf,
        validation=validate(*zip(*frf, strict=True), validation=["c2"]),
        modes=(ModeRow("c1", np.array([9.125, 14.2]), np.array([0.04, 0.06])),),
        study_text="robot: arm.yml  # <the robot>\n",
        provenance={"elastid": "0.1.0", "seed": "17"},
        truth=TRUTH,
        plan=plan(2),
    )
    return replace(content, **changes)


def full_content():
    content = report_content(modes=(mode_row(),))
    return replace(content, dense=tuple((G, 0.01 * np.abs(G.G)) for _, G in content.frf))


def write_report(content: ReportContent, folder: Path, formats: Collection[str]) -> Path:
    """The page of a content with its figures."""
    return write_page(partial(html, content), drawings(content), folder, formats)


def waves() -> list[FloatArray]:
    """Amplitudes 4, 2 and 1 at 3, 6 and 20 Hz, 10 s."""
    t = np.arange(2000) / 200.0
    return [a * np.sin(2 * np.pi * f * t) for a, f in ((4.0, 3.0), (2.0, 6.0), (1.0, 20.0))]


def balance() -> TorqueBalance:
    """Two parts and a rest at 3, 6 and 20 Hz."""
    slow, middle, fast = waves()
    parts = {INERTIA: slow, DRY: middle}
    return torque_balance("joint 1", "log", "N*m", 200.0, slow + middle + fast, parts, (0.0, 32.0))
