"""The figure of a torque part by part shows the numbers that it is drawn from, and the file keeps all of them."""

from pathlib import Path

import numpy as np
from plants.friction_study import friction_result
from plants.report_values import lines_of

from elastid.report.figures.twin import torque_balance_figure
from elastid.store.friction_study import FRICTION, write_friction_result
from elastid.store.twin import read_balances
from elastid.validation.twin import DRY, INERTIA, TorqueBalance, torque_balance


def balance() -> TorqueBalance:
    """Two parts and a rest at 3, 6 and 20 Hz."""
    t = np.arange(1000) / 200.0
    slow, middle, fast = (a * np.sin(2 * np.pi * f * t) for a, f in ((4.0, 3.0), (2.0, 6.0), (1.0, 20.0)))
    parts = {INERTIA: slow, DRY: middle}
    return torque_balance("joint 1", "log", "N*m", 200.0, slow + middle + fast, parts, (0.0, 32.0))


def test_lines_are_the_torques_and_bars_are_left_and_power_by_octave() -> None:
    found = balance()
    whole, parts, left = torque_balance_figure(found).axes
    np.testing.assert_allclose(lines_of(whole)["model without friction"].get_ydata(), found.torques[0], atol=1e-12)
    np.testing.assert_allclose(lines_of(whole)["measured − model"].get_ydata(), found.residual)
    np.testing.assert_allclose(lines_of(parts)[DRY].get_ydata(), found.torques[1])
    bars = {str(each.get_label()): [bar.get_height() for bar in each] for each in left.containers}
    np.testing.assert_allclose(
        bars["left without friction"], [100 * max(band.left_without_friction, 1e-7) for band in found.bands]
    )
    assert [text.get_text() for text in left.get_xticklabels()][-1] == "16–32"


def test_a_balance_comes_back_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "friction.h5"
    write_friction_result(path, friction_result(), balances=[balance()])
    assert repr(read_balances(path, FRICTION)) == repr((balance(),))
    write_friction_result(path, friction_result())
    assert read_balances(path, FRICTION) == ()
