"""Errors on left-out data, and of the torque by part."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from plants.friction_study import friction_content, friction_result
from plants.report_values import lines_of

from elastid.base.arrays import FloatArray
from elastid.report.figures.fit import torque_balance_figure
from elastid.report.page.page_of_friction import html_of_friction
from elastid.store.friction_study import FRICTION, write_friction_result
from elastid.store.results import read_twin
from elastid.validation.twin import (
    DRY,
    INERTIA,
    LINK,
    MOTION,
    TORQUE,
    SignalKind,
    TorqueBalance,
    TwinFindings,
    TwinRun,
    torque_balance,
    twin_signal,
)


def balance() -> TorqueBalance:
    """Two parts and a rest at 3, 6 and 20 Hz."""
    t = np.arange(1000) / 200.0
    slow, middle, fast = (a * np.sin(2 * np.pi * f * t) for a, f in ((4.0, 3.0), (2.0, 6.0), (1.0, 20.0)))
    parts = {INERTIA: slow, DRY: middle}
    return torque_balance("joint 1", "log", "N*m", 200.0, slow + middle + fast, parts, (0.0, 32.0))


def test_lines_are_the_torques_and_below_them_what_is_left_by_octave() -> None:
    found = balance()
    whole, parts, left = torque_balance_figure(found).axes
    np.testing.assert_allclose(lines_of(whole)["model without friction"].get_ydata(), found.torques[0], atol=1e-12)
    np.testing.assert_allclose(lines_of(whole)["measured − model"].get_ydata(), found.residual)
    np.testing.assert_allclose(lines_of(parts)[DRY].get_ydata(), found.torques[1])
    expected = [100 * max(band.left_without_friction, 1e-7) for band in found.bands]
    np.testing.assert_allclose(lines_of(left)["left without friction"].get_ydata(), expected)
    assert [text.get_text() for text in left.get_xticklabels()][-1] == "16–32"


def run() -> TwinRun:
    """Motion, torque and link of a motor, and those of another; without friction only the motion of the first."""
    t = np.arange(1000) / 200.0
    slow, fast = np.sin(2 * np.pi * 3 * t), np.sin(2 * np.pi * 20 * t)
    rows: list[tuple[SignalKind, str, FloatArray | None]] = [
        (MOTION, "motor 1", 0.5 * slow), (TORQUE, "motor 1", None), (LINK, "joint 1", None), (TORQUE, "motor 2", None),
    ]  # fmt: skip
    signals = tuple(twin_signal(kind, place, "N*m", slow + 0.1 * fast, slow, free) for kind, place, free in rows)
    return TwinRun("log", "torque", 0.5, 5.0, 200.0, signals)


def test_both_come_back_from_their_file_and_are_on_the_page(tmp_path: Path) -> None:
    path, twin = tmp_path / "friction.h5", TwinFindings((balance(),), (run(), replace(run(), signals=(), lost="fast")))
    write_friction_result(path, friction_result(), twin=twin)
    assert repr(read_twin(path, FRICTION)) == repr(twin)
    write_friction_result(path, friction_result())
    assert read_twin(path, FRICTION) == TwinFindings()
    html = html_of_friction(replace(friction_content(), twin=twin), ())
    assert "Twin against its log" in html
    assert "the twin is lost: fast" in html
    assert html.count('<td class="text">link motion</td>') == 1
    assert "Twin against its log" not in html_of_friction(friction_content(), ())
