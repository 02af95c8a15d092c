"""Moves are read with their times, keep to a path of poses, and are refused with file, line and column."""

from pathlib import Path

import numpy as np
import pytest
from plants import arm as planar
from plants.commanded_arm import arm
from plants.refusals import refused

from elastid.use.moves import point_to_point, read_move


def written(folder: Path, text: str) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / "move.csv"
    path.write_text(text)
    return path


def test_timed_path_is_passed_at_times(tmp_path: Path) -> None:
    """The first time counts as 0; the duration of the file may be replaced."""
    path = written(tmp_path, "# a path\n t s,1 deg,2 deg\n1.0,0,0\n1.5,10,20\n2.5,30,20\n")
    move = read_move(path, arm(), "tool")
    assert move.duration == 1.5
    np.testing.assert_allclose(move.at(np.array([0.0, 0.5, 1.5])), np.radians([[0, 0], [10, 20], [30, 20]]), atol=1e-12)
    for order in (1, 2):
        np.testing.assert_allclose(move.at(np.array([-1.0, 0.0, 1.5, 2.0]), order), 0.0, atol=1e-9)
    in_ms = written(tmp_path / "ms", "t (ms),1 deg,2 deg\n1000,0,0\n1500,10,20\n2500,30,20\n")
    assert read_move(in_ms, arm(), "tool").duration == 1.5
    slower = read_move(path, arm(), "tool", 3.0)
    np.testing.assert_allclose(slower.at(np.array([1.0]), 1), move.at(np.array([0.5]), 1) / 2)


def test_untimed_path_rests_at_ends_in_duration(tmp_path: Path) -> None:
    """Its middle is that of the way; acceleration and jerk vanish at both ends."""
    move = read_move(written(tmp_path, "1,2\n0,0\n0.4,0.2\n"), arm(), "tool", 2.0)
    np.testing.assert_allclose(move.at(np.array([1.0])), [[0.2, 0.1]], atol=1e-9)
    direct = point_to_point(np.zeros(2), np.array([0.4, 0.2]), 2.0)
    np.testing.assert_allclose(direct.at(np.linspace(0, 2, 9)), move.at(np.linspace(0, 2, 9)))
    for order in (1, 2, 3):
        assert np.abs(move.at(np.array([1e-4, 2 - 1e-4]), order)).max() < 1e-2


def test_a_move_in_milliseconds_is_refused(tmp_path: Path) -> None:
    """A plan of so many seconds would take all memory."""
    with refused("use/move", place="move.csv", holds=("1000 s",)):
        read_move(written(tmp_path, "t,1,2\n0,0,0\n1000,0.4,0.2\n"), arm(), "tool")


def test_a_way_of_poses_is_straight_between_them(tmp_path: Path) -> None:
    """The tool moves along the line, not along the joints' arc; two joints reach no line out of their plane."""
    text, s = "t,x,y,z\n2,0.9,0,-0.3\n3,0.7,{},-0.8\n", np.linspace(0, 1, 50)
    move = read_move(written(tmp_path, text.format(0)), planar.robot(), "tool")
    way = np.outer([-0.2, -0.5], s**3 * (10 - 15 * s + 6 * s**2))
    np.testing.assert_allclose(planar.tool(move.at(s).T), np.array([[0.9], [-0.3]]) + way, atol=1e-5)
    with refused("use/unreachable", place="move.csv:3"):
        read_move(written(tmp_path, text.format(0.1)), planar.robot(), "tool")


@pytest.mark.parametrize("angle", [-2.1, 2.1])
def test_an_angle_beyond_the_limits_of_its_joint_is_refused(tmp_path: Path, angle: float) -> None:
    with refused("use/unreachable", place="move.csv:3"):
        read_move(written(tmp_path, f"1,2\n0,0\n0.4,{angle}\n"), arm(), "tool", 1.0)
