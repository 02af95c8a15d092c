"""Candidates for a configuration: limits, floor, boxes, and what is said where none is left."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.refusals import refused

from elastid.design.configuration_selection import draw_candidates, identifiable
from elastid.design.optimal import DesignCriterion
from elastid.design.spec import BoxSpec, CandidateSpec
from elastid.model.frame_tree import tree
from elastid.model.kinematics import knots, skeleton
from elastid.parameters import Parameter, Parameters
from elastid.robot import Body, Frame, Joint, Limits, Motor, Placement, Robot

MOTOR = Motor(1e-3)
LIMITS = Limits((-1.5, 2.0))
ARM = Robot(
    "arm",
    (
        Body("turret", "base", Placement((0, 0, 0.4)), (Joint("1", "z", motor=MOTOR),), 1.0, inertia=1.0),
        Body("upper", "turret", joints=(Joint("2", "y", motor=MOTOR, limits=LIMITS),), mass=1.0, inertia=1.0),
        Body("fore", "upper", Placement((0, 0, 0.5)), (Joint("3", "y", motor=MOTOR, limits=LIMITS),), 1.0, (0.5, 0, 0)),
    ),
    frames=(Frame("hand", "fore", Placement((0.7, 0, 0.1))),),
)


def _angles(spec: CandidateSpec, seed: int = 1, swing: float = 0.0) -> np.ndarray:
    return np.array([c.angles for c in draw_candidates(spec, ARM, seed, swing).configurations])


def test_candidates_respect_limits_and_depend_on_seed() -> None:
    """A joint without limits turns within +-180 deg."""
    spec = CandidateSpec(random=2000, margin=0.0)
    angles = _angles(spec, swing=0.1)
    assert angles.shape == (2000, 3)
    np.testing.assert_allclose(angles.min(axis=0), [-math.pi, -1.4, -1.4], atol=0.01)
    np.testing.assert_allclose(angles.max(axis=0), [math.pi, 1.9, 1.9], atol=0.01)
    np.testing.assert_array_equal(angles, _angles(spec, swing=0.1))
    assert not np.array_equal(angles, _angles(spec, seed=2, swing=0.1))


def test_a_grid_reaches_from_limit_to_limit() -> None:
    """One number for all joints or one for each."""
    assert len(_angles(CandidateSpec(grid=3))) == 27
    angles = _angles(CandidateSpec(grid=(1, 2, 3), margin=0.0))
    assert sorted(set(angles[:, 2].tolist())) == pytest.approx([-1.5, 0.25, 2.0])
    assert set(angles[:, 1].tolist()) == {-1.5, 2.0}
    assert set(angles[:, 0].tolist()) == {0.0}


def test_admissible_postures_avoid_obstacles_and_free_ones_stay() -> None:
    """Joints, centres of mass, a frame, and points on the way between, against the skeleton's own numbers."""
    box = BoxSpec("post", (0.2, -0.3, 0.0), (0.6, 0.3, 0.8))
    spec = CandidateSpec(random=500, floor=0.1, boxes=(box,), clearance=0.05)
    found = draw_candidates(spec, ARM, 1)
    kept = np.array([c.angles for c in found.configurations])
    every = _angles(CandidateSpec(random=500))

    owners = [knot.owner for knot in knots(ARM, tree(ARM))]

    def is_free(angles: np.ndarray) -> bool:
        drawn = skeleton(ARM, angles[None])
        points = drawn.points[0][drawn.moves]
        joint2, joint3, tool, point = map(owners.index, ("2", "3", "fore", "hand"))
        way = np.linspace(0, 1, 7)[:, None]
        for end in (tool, point):
            along = drawn.points[0][joint3] + way * (drawn.points[0][end] - drawn.points[0][joint3])
            points = np.concatenate([points, along])
        upper = drawn.points[0][joint2]
        points = np.concatenate([points, upper + way[1:] * (drawn.points[0][joint3] - upper)])
        in_box = np.all((points > np.array(box.lower) - 0.05) & (points < np.array(box.upper) + 0.05), axis=1)
        return bool(points[:, 2].min() >= 0.15 and not in_box.any())

    free = np.array([is_free(one) for one in every])
    assert 0.05 < free.mean() < 0.95
    np.testing.assert_array_equal(kept, every[free])
    assert sum(found.refused.values()) == 500 - len(kept)
    assert set(found.refused) == {"reach the floor", "reach into box post"}


@pytest.mark.parametrize(
    ("spec", "place"),
    [
        (CandidateSpec(floor=2.0), ""),
        (CandidateSpec(boxes=(BoxSpec("all", (-9, -9, -9), (9, 9, 9)),)), ""),
        (CandidateSpec(given={"a": (0, 3, 0)}), ""),
        (CandidateSpec(given={"a": (0, 1)}), ".given.a"),
        (CandidateSpec(grid=(2, 2)), ".grid"),
        (CandidateSpec(grid=100), ".grid"),
    ],
)
def test_no_admissible_candidate_is_refused_with_what_would_help(spec: CandidateSpec, place: str) -> None:
    with refused("design/candidates", place=f"design.candidates{place}"):
        draw_candidates(spec, ARM, 1)


def test_a_carrier_too_wide_for_the_limits_is_refused() -> None:
    with refused("design/candidates", place="design.candidates"):
        draw_candidates(CandidateSpec(), ARM, 1, swing=1.8)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), decades=st.lists(st.floats(-5, 5), min_size=4, max_size=4))
def test_candidates_inform_the_same_numbers_whatever_their_units(seed: int, decades: list[float]) -> None:
    """Two numbers that only a sum shows are wanted no more; what stands for their difference is in its units."""
    rng, unit = np.random.default_rng(seed), 10.0 ** np.array(decades)
    J = rng.standard_normal((6, 4, 3)) + 1.0
    J[:, 3] = J[:, 2]
    H, difference = J @ np.swapaxes(J, 1, 2), np.array([0.0, 0.0, 1.0, -1.0]) / unit
    numbers = Parameters(tuple(Parameter(name, 1.0) for name in "abcd"))
    wanted, ground = identifiable(DesignCriterion(np.eye(4)), H * np.outer(unit, unit), np.zeros((4, 4)), numbers)
    np.testing.assert_array_equal(wanted.interest, np.eye(4)[:, :2])
    assert difference @ ground @ difference == pytest.approx(np.trace(H.mean(axis=0)[2:, 2:]), rel=1e-6)
