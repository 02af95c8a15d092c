"""Robots by Denavit-Hartenberg parameters: against the product of the matrices."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.refusals import refused
from ruamel.yaml import YAML

from elastid.model.kinematics import frame_poses
from elastid.robot import Placement, Robot
from elastid.study import load_robot

MOTOR = {"inertia": 1e-300}

# Corke and Armstrong-Helouvry (1994): d, a, alpha, mass, centre of mass, inertia about it. Inertias of links 1 and 3 as
# published belong to no body (Iyy = 0.35 alone; 0.066, 0.086, 0.0125): the first acts about one axis only and stands
# for all, of the third Izz is raised to the least that a body can have.
PUMA = (
    (0.67183, 0, 90, 0, (0, 0, 0), (0.35, 0.35, 0.35)),
    (0, 0.4318, 0, 17.4, (-0.3638, 0.006, 0.2275), (0.13, 0.524, 0.539)),
    (0.15005, 0.0203, -90, 4.8, (-0.0203, -0.0141, 0.070), (0.066, 0.086, 0.02)),
    (0.4318, 0, 90, 0.82, (0, 0.019, 0), (1.8e-3, 1.3e-3, 1.8e-3)),
    (0, 0, -90, 0.34, (0, 0, 0), (0.3e-3, 0.4e-3, 0.3e-3)),
    (0, 0, 0, 0.09, (0, 0, 0.032), (0.15e-3, 0.15e-3, 0.04e-3)),
)

# Gautier and Janot's Staeubli TX40, modified: d, a, alpha, offset, mass, first moment, inertia about the origin.
TX40 = (
    (0, 0, 0, 0, 8.61, (0, 0, -0.4305), (0.424, 0.424, 0.352, 0, 0, 0)),
    (0, 0, -90, -90, 4.85, (0.392, -0.0072, 0.162), (1.63e-2, 8.81e-2, 8.28e-2, 7.85e-4, -1.57e-2, 3.24e-4)),
    (0.035, 0.225, 0, 90, 4.07, (0.0326, 0.0244, 0.265), (2.23e-2, 2.24e-2, 4.41e-3, -1.95e-4, -1.16e-3, -2.22e-3)),
    (0.225, 0, 90, 0, 3.62, (0.0145, -0.00724, -0.586), (0.109, 0.108, 4.07e-3, 2.9e-5, 1.35e-3, -1.17e-3)),
    (0, 0, -90, 0, 1.02, (0, -0.00306, -0.00102), (1.01e-3, 1.00e-3, 1.01e-3, 0, 0, -3.06e-6)),
    (0, 0, 90, 180, 0.2, (0, 0, 0.0084), (3.53e-3, 3.53e-3, 3.53e-4, 0, 0, 0)),
)


def link(i: int, d: float, a: float, alpha: float, mass: float, center: list[float], inertia: Any) -> dict[str, Any]:
    frame = {"d": d, "a": a, "alpha": f"{alpha} deg"}
    weight = {"mass": mass, "center_of_mass": center, "inertia": list(inertia)}
    return {"joint": {"name": str(i), "motor": MOTOR}, **frame, **weight}


def puma() -> dict[str, Any]:
    links = [link(i, *frame, m, list(c), inertia) for i, (*frame, m, c, inertia) in enumerate(PUMA, start=1)]
    return {"name": "puma", "convention": "standard", "links": links, "tool": {"xyz": [0.01, 0.02, 0.1]}}


def tx40() -> dict[str, Any]:
    links = [
        link(i, *frame, m, [each / m for each in moment], inertia) | {"offset": f"{offset} deg"}
        for i, (*frame, offset, m, moment, inertia) in enumerate(TX40, start=1)
    ]
    return {"name": "tx40", "convention": "modified", "inertia_about": "origin", "links": links}


def scara() -> dict[str, Any]:
    """Two turns, a slide with a fixed angle, and a turn, on a tilted base."""
    kinds = ("rotation", "rotation", "translation", "rotation")
    links = [
        {
            "joint": {"name": str(i), "motion": kind, "motor": MOTOR},
            "d": 0.1 * i,
            "a": 0.3,
            "alpha": f"{20 * i} deg",
            "offset": f"{15 * i} deg",
            "mass": 3,
            "center_of_mass": [0.1, 0.05 * i, -0.1],
            "inertia": [0.3, 0.4, 0.5, 0.01, 0.02, 0.03],
        }
        for i, kind in enumerate(kinds, start=1)
    ]
    return {
        "name": "scara",
        "convention": "standard",
        "links": links,
        "base": {"rpy": [0.3, 0.2, 0.1], "xyz": [1, 2, 3]},
    }


def read(document: dict[str, Any], folder: Path) -> Robot:
    path = folder / "robot.yml"
    YAML(typ="safe").dump(document, path)
    return load_robot(path)


def angle(text: object) -> float:
    """Of '90 deg' and 0."""
    return np.radians(float(str(text).removesuffix(" deg")))


def matrices(document: dict[str, Any], q: np.ndarray) -> list[np.ndarray]:
    """A_i (4, 4) of each link, written out entry by entry as in the textbooks."""
    found = []
    for link, value in zip(document["links"], q, strict=True):
        slides = link["joint"].get("motion") == "translation"
        d, a = link["d"] + value * slides, link["a"]
        theta = angle(link.get("offset", 0)) + value * (not slides)
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(angle(link["alpha"])), np.sin(angle(link["alpha"]))
        if document["convention"] == "standard":
            A = [[ct, -st * ca, st * sa, a * ct], [st, ct * ca, -ct * sa, a * st], [0, sa, ca, d], [0, 0, 0, 1]]
        else:
            A = [[ct, -st, 0, a], [st * ca, ct * ca, -sa, -d * sa], [st * sa, ct * sa, ca, d * ca], [0, 0, 0, 1]]
        found.append(np.array(A))
    return found


@pytest.mark.parametrize("make", [puma, tx40, scara, lambda: scara() | {"convention": "modified"}])
def test_links_stand_at_product_of_matrices(make, tmp_path):
    """Both conventions, joints that slide, a base and a tool."""
    document = make()
    robot = read(document, tmp_path)
    base = Placement(**{key: tuple(value) for key, value in document.get("base", {}).items()})
    for q in np.random.default_rng(0).uniform(-3, 3, (4, len(robot.joints))):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = base.rotation, base.xyz
        for body, A in zip(robot.bodies, matrices(document, q), strict=True):
            T = T @ A
            pose = frame_poses(robot, q[None], body.name)
            np.testing.assert_allclose(pose.position[0], T[:3, 3], atol=1e-12)
            np.testing.assert_allclose(pose.rotation[0], T[:3, :3], atol=1e-12)
        tool = frame_poses(robot, q[None], "tool").position[0]
        offset = document.get("tool", {"xyz": [0, 0, 0]})["xyz"]
        np.testing.assert_allclose(tool, T[:3, 3] + T[:3, :3] @ offset, atol=1e-12)


def test_inertia_about_origin_moves_to_centre(tmp_path):
    """Less m (c^2 1 - c c^T), whatever the link."""
    for body, (*_, m, moment, about_origin) in zip(read(tx40(), tmp_path).bodies, TX40, strict=True):
        xx, yy, zz, xy, xz, yz = about_origin
        c = np.array(moment) / m
        expected = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (c @ c * np.eye(3) - np.outer(c, c))
        np.testing.assert_allclose(body.center_of_mass, c, atol=1e-12)
        np.testing.assert_allclose(body.inertia_matrix, expected, atol=1e-12)


def test_a_table_has_couplings_of_gears(tmp_path):
    """The sixth motor of the TX40 turns with its fifth joint."""
    robot = read(tx40() | {"gears": [{"motor": "6", "joint": "5", "ratio": 0.5}]}, tmp_path)
    np.testing.assert_array_equal(np.argwhere(robot.mixing - np.eye(6)), [[5, 4]])


@pytest.mark.parametrize(
    ("edit", "says"),
    [
        (lambda d: d.update(links=[]), "links"),
        (lambda d: d["links"][2].update(theta=1), "links[2].theta"),
        (lambda d: d["links"][2]["joint"].update(axis="x"), "links[2]"),
        (lambda d: d["links"][1].update(inertia=[1, 1, 3]), "inertia"),
        (lambda d: d["links"][1].update(inertia=[1, 1]), "links[1].inertia"),
        (lambda d: d["links"][1]["joint"].update(name="1"), "body 1"),
        (lambda d: d.update(convention="craig"), "convention"),
        (lambda d: d.update(payload={"mass": 1, "at": "hand"}), "hand"),
        (lambda d: d.update(frames=[{"name": "tool", "body": "6"}]), "frame tool"),
        (lambda d: d["links"][0].update(alpha=-90), "-90 deg"),
        (lambda d: d["links"][0]["joint"].update(spring={"stiffness": "1e6 N/m"}), "joint 1"),
    ],
)
def test_a_table_that_is_wrong_is_refused_with_its_place(edit, says, tmp_path):
    """Each message names file, line and what to do."""
    document = copy.deepcopy(puma())
    edit(document)
    with refused("study/invalid", holds=says) as caught:
        read(document, tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'robot.yml'}:")
