"""Postures of paths, grids and random ones; inverse kinematics."""

from pathlib import Path

import numpy as np
import pytest
from plants.arm import robot
from plants.fitted_models import fitted_model
from plants.refusals import refused

from elastid.base.errors import StudyError
from elastid.model.closed_posture import are_closed, assemble, follow_angles
from elastid.model.kinematics import frame_poses
from elastid.robot import Body, Joint, Limits, Motor, Robot
from elastid.use.path_table import read_path
from elastid.use.postures import grid_postures, inverse_kinematics, limits_of, random_postures


@pytest.mark.slow
@pytest.mark.parametrize("name", ["manutec", "linkage_arm minimal"])
def test_poses_that_some_posture_has_are_reached_within_the_limits(name: str) -> None:
    """Six axes with orientation, and a linkage by its position."""
    own = fitted_model(name).model.robot
    frame = own.frames[-1].name if own.frames else own.bodies[-1].name
    angles = random_postures(own, 8, 3)
    poses = frame_poses(own, follow_angles(own, angles), frame)
    rotation = poses.rotation if name == "manutec" else None
    reached, found = inverse_kinematics(own, frame, poses.position, rotation)
    assert found.mean() >= 0.85
    low, high = limits_of(own).T
    assert np.all((reached >= low) & (reached <= high))
    there = frame_poses(own, follow_angles(own, reached[found]), frame)
    np.testing.assert_allclose(there.position, poses.position[found], atol=2e-6)


def test_one_sided_limit_leaves_full_turn() -> None:
    joint = Joint("1", motor=Motor(1e-3), limits=Limits((4.0, np.inf)))
    robot = Robot("one", (Body("load", joints=(joint,), inertia=1.0),))
    np.testing.assert_allclose(limits_of(robot), [[4.0, 4.0 + 2 * np.pi]])


def test_path_of_angles_or_poses_has_its_units(tmp_path: Path) -> None:
    """Degrees by the name of the column; semicolons, tabs and decimal commas; a pose out of reach is numbered."""
    path = tmp_path / "path.csv"
    path.write_text("2 (deg);1;note\n90;0,5;0\n")
    np.testing.assert_allclose(read_path(path, robot(), "tool")[0], [[0.5, np.pi / 2]])
    path.write_text("2 (mrad)\t1 (°)\n5,0e2\t90\n", encoding="utf-8")
    np.testing.assert_allclose(read_path(path, robot(), "tool")[0], [[np.pi / 2, 0.5]])
    path.write_text("x,y,z\n1.0,0,0\n9,0,0\n0.9,0,-0.2\n")
    angles, (remark,) = read_path(path, robot(), "tool")
    assert "1 of the path's postures (row 2) are out of reach" in remark
    there = frame_poses(robot(), follow_angles(robot(), angles), "tool").position
    np.testing.assert_allclose(there, [[1, 0, 0], [0.9, 0, -0.2]], atol=2e-6)
    path.write_text("x (mm),y (mm),z\n1000,0,0\n900,0,-0.2\n")
    in_mm, _ = read_path(path, robot(), "tool")
    np.testing.assert_allclose(frame_poses(robot(), follow_angles(robot(), in_mm), "tool").position, there, atol=4e-6)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("a,b\n1,2\n", ""),
        ("1,2\n", ""),
        ("1,2\n0,up\n", ":2"),
        ("1,2\n0\n", ":2"),
        ("1,2\n0,nan\n", ":2"),
        ("1 2\n0.5 1\n", ":2"),
        ("x,y,z\n9,9,9\n", "frame tool"),
        ("1 (mm),2\n0,1\n", "mm"),
        ("1 (deg),1,2\n0,0,1\n", "name 1"),
        ("x,y,z,rx\n1,0,0,0\n", "rx"),
    ],
)
def test_invalid_path_is_refused_with_reason(tmp_path: Path, text: str, place: str) -> None:
    path = tmp_path / "path.csv"
    path.write_text(text)
    with refused("use/path", "files/table", "use/unreachable", holds=place):
        read_path(path, robot(), "tool")


def test_a_grid_fills_the_workspace_evenly() -> None:
    """Of a robot that turns and bends: neighbours are one spacing apart."""
    own = fitted_model("scara").model.robot
    postures = grid_postures(own, "quill", 6)
    at = np.unique(frame_poses(own, follow_angles(own, postures), "quill").position.round(5), axis=0)
    assert len(at) == len(postures) > 8
    gaps = np.linalg.norm(at[:, None] - at[None], axis=2)[np.triu_indices(len(at), 1)]
    longest = np.ptp(frame_poses(own, follow_angles(own, random_postures(own, 2000)), "quill").position, axis=0).max()
    assert gaps.min() == pytest.approx(longest / 5, rel=1e-3)


@pytest.mark.slow
def test_random_linkage_postures_close_without_folding() -> None:
    """As a single posture is judged; some of those that are drawn are refused."""
    own = fitted_model("irb4400_linkage minimal").model.robot
    for angles in random_postures(own, 25, 1):
        assemble(own, angles)
    low, high = limits_of(own).T
    drawn = np.random.default_rng(1).uniform(low, high, (200, len(low)))
    joints = follow_angles(own, drawn)
    for angles, is_closed in zip(drawn[:25], are_closed(own, joints)[:25], strict=True):
        if not is_closed:
            with pytest.raises(StudyError):
                assemble(own, angles)
