"""A mode as it is seen: the sticks swing as the shape says, far enough, from where it shows, and what words say."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.colors import to_hex
from plants.report_values import fit_result, report_content

from elastid.app.summaries import modes_of
from elastid.fit.fitted_model import FittedModel
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linearise import linearise
from elastid.linear.modes import modes, shapes_of_all
from elastid.model.formulation import formulate
from elastid.model.kinematics import frame_poses
from elastid.model.stick_figure import StickFigure, stick_figure
from elastid.parameters import Parameter, ParameterSet
from elastid.record import Configuration
from elastid.report.content import ReportContent
from elastid.report.figures import style
from elastid.report.figures.drawings import drawings
from elastid.report.figures.mode_sketches import mode_sketches
from elastid.report.modes.mode_drawing import SWING, ModeDrawing, mode_drawing
from elastid.report.modes.mode_row import ModeRow, load_name, shares_in_words, spring_names
from elastid.report.numbers import number
from elastid.report.page.booklet import front_pages
from elastid.report.page.mode_viewer import mode_viewer
from elastid.report.page.page import html, rendered
from elastid.response import FrequencyResponse
from elastid.robot import (
    Anchor,
    Body,
    CoilSpring,
    Compensator,
    Frame,
    Joint,
    Loop,
    Motor,
    Placement,
    Robot,
    Rod,
    Spring,
)

MOTOR = Motor(1e-3, 100.0, 2e-3)
ARM = Robot(
    "arm",
    (
        Body("turret", "base", Placement((0, 0, 0.4)), (Joint("1", "z", Spring(3e5, 900), MOTOR),),
             80, (0, 0, 0.1), 6.0),
        Body("upper", "turret", Placement((0.2, 0, 0.3)), (Joint("2", "y", Spring(4e5, 300), MOTOR),),
             40, (0, 0, 0.4), 2.0),
        Body("half", "upper", Placement((0, 0, 0.4)),
             (Joint("b", "y", Spring(9e5, 90)), Joint("t", "z", Spring(2e5, 20))), 20, (0, 0, 0.2), 1.0),
        Body("fore", "half", Placement((0, 0, 0.4)), (Joint("3", "y", Spring(2e5, 200), MOTOR),),
             30, (0.3, 0.1, 0), 2.0),
    ),
    frames=(Frame("tool", "fore", Placement((0.8, 0.1, 0))),),
)  # fmt: skip
ANGLES = np.array([0.4, 0.3, -0.2])


def swinging(robot: Robot, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, StickFigure]:
    """Joints at rest (n_l,), frequencies, the joints' part of the shapes, and the sticks."""
    model = formulate(robot)
    at = Configuration("c1", angles)
    linear = linearise(model, at, model.theta, model.inputs, "position")
    found = modes(linear, linear.theta_ref)
    n_l = len(robot.joints)
    q = equilibrium(model, model.theta, at).q[:n_l]
    return q, found.freq_hz, shapes_of_all(linear, found.shapes)[:n_l], stick_figure(robot, q)


def drawn(robot: Robot = ARM, angles: np.ndarray = ANGLES) -> ModeDrawing:
    _, _, shapes, figure = swinging(robot, angles)
    drawing = mode_drawing(figure, shapes, robot.gravity)
    assert drawing is not None
    return drawing


def test_the_tool_moves_as_the_shape_moves_the_kinematics() -> None:
    """By one factor in all directions: differences of the pose along real and imaginary part of the shape."""
    q, freq_hz, shapes, figure = swinging(ARM, ANGLES)
    drawing = mode_drawing(figure, shapes, ARM.gravity)
    assert drawing is not None
    for mode in range(len(freq_hz)):
        h, tool = 1e-6, []
        for part in (shapes[:, mode].real, shapes[:, mode].imag):
            ends = frame_poses(ARM, np.stack([q + h * part, q - h * part]), "tool").position
            tool.append((ends[0] - ends[1]) / (2 * h))
        expected, moved = tool[0] + 1j * tool[1], drawing.moved[-1, :, mode]
        factor = (expected.conj() @ moved) / (expected.conj() @ expected)
        np.testing.assert_allclose(moved, factor * expected, atol=1e-6 * np.abs(moved).max())


def test_every_mode_swings_by_the_same_part_of_the_robot_s_size() -> None:
    """And at t = 0 further than at any other time, however the damping turns the phases."""
    drawing = drawn()
    furthest = np.linalg.norm(drawing.moved.real, axis=1).max(axis=0)
    np.testing.assert_allclose(furthest, SWING * np.ptp(drawing.points, axis=0).max())
    turned = [((drawing.moved * np.exp(1j * a)).real ** 2).sum(axis=(0, 1)) for a in np.linspace(0, np.pi, 60)]
    assert np.all(turned[0] >= np.max(turned, axis=0) * (1 - 1e-12))


@settings(max_examples=20, deadline=None)
@given(st.floats(1e-3, 1e3), st.floats(-np.pi, np.pi))
def test_a_drawing_knows_neither_length_nor_phase_of_a_shape(length: float, phase: float) -> None:
    _, _, shapes, figure = swinging(ARM, ANGLES)
    one, other = (mode_drawing(figure, z * shapes, ARM.gravity) for z in (1.0, length * np.exp(1j * phase)))
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one.moved, other.moved, atol=1e-9)


def test_a_plane_mode_has_one_view_and_another_two() -> None:
    """Up is up; the second view shows what the first cannot."""
    plane = drawn(angles=np.array([0.0, 0.3, -0.2]))
    views = [plane.views(mode) for mode in range(plane.moved.shape[2])]
    assert {len(pair) for pair in views} == {1, 2}
    for mode, pair in enumerate(views):
        largest = np.abs(plane.moved[:, :, mode]).max(axis=0)
        (missing,) = {0, 1, 2} - set(pair[0])
        assert (len(pair) == 1) == (largest[missing] <= 0.1 * largest.max())
        assert len(pair) == 1 or set(pair[0]) | set(pair[1]) == {0, 1, 2}
        assert all(2 not in view or view[1] == 2 for view in pair)


def test_a_robot_seen_end_on_is_no_view_of_it() -> None:
    """A pole swings to all sides: from the side, not from above, where it is a point."""
    pole = Robot(
        "pole",
        (
            Body("a", joints=(Joint("1", "x", Spring(1e5), MOTOR), Joint("2", "y", Spring(1e5))), mass=10,
                 center_of_mass=(0, 0, 1.0), inertia=1.0),
        ),
        gravity=(0, 0, 0),
    )  # fmt: skip
    figure = stick_figure(pole, np.zeros(2))
    drawing = mode_drawing(figure, np.array([[1.0], [0.9]], complex), pole.gravity)
    assert drawing is not None
    assert set(drawing.views(0)) == {(0, 2), (1, 2)}


@pytest.mark.parametrize(("gravity", "up", "hanging"), [((0, -9.81, 0), 1, False), ((0, 0, 9.81), 2, True)])
def test_a_robot_hangs_as_gravity_has_it(gravity: tuple[float, float, float], up: int, hanging: bool) -> None:
    """The axis keeps its numbers and points down where the robot hangs from the ceiling."""
    robot = replace(ARM, gravity=gravity)
    _, freq_hz, shapes, figure = swinging(robot, ANGLES)
    drawing = mode_drawing(figure, shapes, gravity)
    assert drawing is not None
    assert (drawing.up, drawing.hanging) == (up, hanging)
    row = ModeRow("c1", freq_hz, 0.05 * np.ones(len(freq_hz)), drawing=drawing)
    for (_, (_, upwards)), slopes in sketched(row, drawing).items():
        assert slopes[0, 0] > 0
        assert (slopes[0, 1] < 0) == (hanging and upwards == up)


def test_where_nothing_is_seen_to_move_nothing_is_drawn() -> None:
    """All points in one; a motor alone; and one mode that moves no point beside one that does."""
    one_point = Robot("bench", (Body("load", joints=(Joint("1", "z", Spring(50.0), MOTOR),), inertia=1e-3),))
    _, _, shapes, figure = swinging(one_point, np.zeros(1))
    assert shapes.size
    assert mode_drawing(figure, shapes, (0, 0, 0)) is None
    figure = stick_figure(ARM, np.zeros(5))
    assert mode_drawing(figure, np.zeros((5, 2), complex), ARM.gravity) is None
    assert mode_drawing(figure, np.zeros((5, 0), complex), ARM.gravity) is None
    one = mode_drawing(figure, np.eye(5, 2, dtype=complex) * [1.0, 1e-9], ARM.gravity)
    assert one is not None
    assert np.abs(one.moved[:, :, 0]).max() > 0.1
    assert not one.moved[:, :, 1].any()
    rendered(mode_sketches(ModeRow("c", np.ones(2), np.ones(2)), one, "c", True), "png")


def test_a_slide_moves_along_its_axis() -> None:
    """Straight, and its mode is drawn."""
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, 600.0), motion="translation")
    load = Body("load", "carriage", Placement((0, 0, 0.3)), (Joint("e", "x", Spring(8e5), motion="translation"),), 25)
    drawing = drawn(Robot("slide", (Body("carriage", joints=(joint,), mass=40), load)), np.array([0.3]))
    assert not drawing.moved[:, 1:].any()
    assert drawing.views(0) == ((0, 2),)


def test_springs_are_called_what_they_are() -> None:
    """Gears, shafts, what bends or twists amid a link, other joints, rods, and the weight."""
    names = spring_names(ARM)
    assert (names["k_2"], names["km_2"], names["k_b"], names["k_t"]) == (
        "gear 2",
        "shaft of motor 2",
        "bending b",
        "torsion t",
    )
    foot = Body("foot", joints=(Joint("y", "y", Spring(1e6)), Joint("1", "z", Spring(1e5), MOTOR)), inertia=1.0)
    ends = (Anchor("foot"), Anchor("base", (1, 0, 0)))
    loops = (Loop("coupler", ends, rod=Rod(1.0, stiffness=1e6)), Loop("rod", ends, rod=Rod(1.0, stiffness=1e6)))
    robot = Robot("foot", (foot,), loops=loops, compensators=(Compensator("c", ends, CoilSpring(1.0)),))
    names = spring_names(robot)
    assert (names["k_y"], names["k_coupler"], names["k_rod"]) == ("joint y", "rod coupler", "rod")
    assert (load_name(ARM), load_name(robot)) == ("weight", "weight and compensators")
    assert set(formulate(ARM).springs) <= set(spring_names(ARM))
    assert shares_in_words(["a", "b"], np.array([np.nan, np.nan])) == ""


def mode_row(name: str = "c1") -> ModeRow:
    _, freq_hz, shapes, figure = swinging(ARM, ANGLES)
    energy = np.full((2, len(freq_hz)), 0.5)
    energy[:, 0] = 0.925, 0.075
    drawing = mode_drawing(figure, shapes, ARM.gravity)
    coordinates = tuple(f"joint {joint.name}" for joint in ARM.joints)
    zeta = np.full(len(freq_hz), 0.0421)
    return ModeRow(
        name, freq_hz, zeta, coordinates=coordinates, shapes=shapes, stores=("gear 2", "rod"), energy=energy,
        drawing=drawing,
    )  # fmt: skip


def sketched(row: ModeRow, drawing: ModeDrawing) -> dict[tuple[int, tuple[int, int]], np.ndarray]:
    """Inches to a metre along both axes (3, 2) of the sticks at rest, at one end and at the other, view by view."""
    views = [(mode, view) for mode in range(len(row.frequency_hz)) for view in drawing.views(mode)]
    collections = mode_sketches(row, drawing, "c1", True).axes[0].collections
    colors = (style.WEAK, style.FITTED, style.MEASURED)
    sticks = [next(one for one in collections if to_hex(one.get_edgecolor()[0]) == color.lower()) for color in colors]
    drawn_at = [np.array(one.get_segments()).reshape(len(views), -1, 2) for one in sticks]
    pairs = np.array([link[:2] for link in drawing.links])
    found = {}
    for i, (mode, view) in enumerate(views):
        slopes = []
        for sign, inches in zip((0, -1, 1), drawn_at, strict=True):
            points = (drawing.points + sign * drawing.moved[:, :, mode].real)[pairs][..., list(view)].reshape(-1, 2)
            lines = [np.polyfit(points[:, k], inches[i, :, k], 1) for k in (0, 1)]
            for k in (0, 1):
                np.testing.assert_allclose(np.polyval(lines[k], points[:, k]), inches[i, :, k], atol=1e-9)
            slopes.append([line[0] for line in lines])
        found[mode, view] = np.array(slopes)
    return found


def test_the_sketches_show_rest_and_both_ends_to_one_scale() -> None:
    """Grey, orange and blue sticks at points - moved, points and points + moved, a panel for each view."""
    row = mode_row()
    drawing = row.drawing
    assert drawing is not None
    slopes = np.array([*sketched(row, drawing).values()])
    assert len(slopes) > len(row.frequency_hz)
    np.testing.assert_allclose(slopes, slopes[0, 0, 0])
    figure = mode_sketches(row, drawing, "c1", True)
    words = [text.get_text().replace("\u00a0", " ") for text in figure.axes[0].texts]
    assert f"mode 1: {number(row.frequency_hz[0])} Hz, 4.2 %\n92 % gear 2, 8 % rod" in words
    views = [view for mode in range(len(row.frequency_hz)) for view in drawing.views(mode)]
    assert [word for word in words if word.endswith("in m")] == [f"{'xyz'[a]} in m" for view in views for a in view]
    segments = np.concatenate([np.array(one.get_segments()).reshape(-1, 2) for one in figure.axes[0].collections])
    assert np.all((segments > 0) & (segments < figure.get_size_inches()))


def test_a_report_draws_sticks_where_there_are_any_and_bars_elsewhere() -> None:
    """Under one name; the energy in words above the bars as well."""
    bench = replace(mode_row("c2"), drawing=None)
    found = {d.name: d.figure for d in drawings(report_content(modes=(mode_row(), bench))) if d.name.endswith("modes")}
    assert [len(axes.patches) for axes in found["frf-c2-modes"].axes] == [5] * len(bench.frequency_hz)
    assert found["frf-c2-modes"].axes[0].get_title(loc="left") == "92 % gear 2, 8 % rod"
    assert len(found["frf-c1-modes"].axes) == 1


def test_the_front_pages_hold_the_mode_table() -> None:
    """No line is longer than the paper is wide."""
    long = replace(mode_row(), stores=("gear of the very first axis of the robot", "shaft of the motor of that axis"))
    pages = [page.texts[0].get_text() for page in front_pages(report_content(modes=(long,)))]
    assert "92 % gear of the very first axis" in " ".join(" ".join(pages).split())
    assert max(len(line) for page in pages for line in page.splitlines()) <= 96


def test_energies_follow_the_numbers_of_a_configuration() -> None:
    """A gear that is softer when warm holds more of the energy there; everything else is the same."""
    parameters = ParameterSet(
        (
            *(Parameter(name, value, free=False) for name, (value, _) in ARM.parameters().items()),
            Parameter("delay", 0.0, "s", free=False),
            Parameter("k_2@warm", 2e5, log=True, only=("warm",)),
        )
    )
    result = replace(
        fit_result(), parameters=parameters, x=parameters.x, covariance=1e-4 * np.eye(1), at_bound=np.zeros(1, bool),
        starts=(), singular_values=np.ones(1),
    )  # fmt: skip
    freq_hz = np.array([5.0, 10.0])
    places, nothing = ARM.motor_locations, np.zeros((2, 3, 3), complex)
    responses = [
        FrequencyResponse(freq_hz, nothing, places, places, "acceleration", Configuration(name, ANGLES))
        for name in ("cold", "warm")
    ]
    cold, warm = modes_of(FittedModel.of(result, ARM, responses))
    assert cold.stores == ("gear 1", "gear 2", "bending b", "torsion t", "gear 3", "weight")
    for row in (cold, warm):
        np.testing.assert_allclose(row.energy.sum(axis=0), 1.0)
        assert row.drawing is not None
    _, all_soft, *_ = swinging(ARM.with_parameters({"k_2": 2e5}), ANGLES)
    np.testing.assert_allclose(warm.frequency_hz, all_soft, rtol=1e-9)
    gear = cold.stores.index("gear 2")
    assert warm.energy[gear, 1] != pytest.approx(cold.energy[gear, 1], rel=0.05)


# On the page.


def test_the_page_says_where_the_energy_is() -> None:
    text = html(report_content(modes=(mode_row(),)), []).replace("\u00a0", " ")
    assert "92 % gear 2, 8 % rod" in text
    assert "mode-viewer" in text
    plain = html(report_content(modes=(replace(mode_row(), drawing=None),)), [])
    assert "mode-data" not in plain
    assert "PERIOD" not in plain


def test_the_modes_of_twenty_configurations_of_a_six_axis_robot_are_a_third_of_a_megabyte() -> None:
    """Thirty points, eighteen modes."""
    rng = np.random.default_rng(0)
    moved = 0.1 * (rng.standard_normal((30, 3, 18)) + 1j * rng.standard_normal((30, 3, 18)))
    drawing = ModeDrawing(rng.standard_normal((30, 3)), tuple((i, i + 1, "arm") for i in range(29)), (1, 2), moved)
    row = ModeRow("c", np.arange(1.0, 19.0), np.full(18, 0.05), drawing=drawing)
    viewer = mode_viewer([row] * 20, True)
    assert viewer is not None
    assert len(viewer.data) < 350_000


def written(content: ReportContent, folder: Path) -> Path:
    """The page without its figures."""
    path = folder / "report.html"
    path.write_text(html(content, []), "utf-8")
    return path


@pytest.fixture
def table(browser, tmp_path):  # type: ignore[no-untyped-def]
    """The page of one configuration that can be drawn and one that cannot, in a browser; it complains of nothing."""
    content = report_content(modes=(mode_row(), replace(mode_row("c2"), drawing=None)))
    path = written(content, tmp_path)
    opened = []

    def visit(**options):  # type: ignore[no-untyped-def]
        page = browser.new_page(viewport={"width": 1200, "height": 900}, **options)
        complaints: list[str] = []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(path.as_uri())
        opened.append(complaints)
        return page

    yield visit
    assert opened
    assert not any(opened)


def sticks(page, view=0):  # type: ignore[no-untyped-def]
    """Where the swinging sticks are drawn."""
    return page.locator("#mode-viewer svg").nth(view).locator(".moving path").evaluate_all(
        "paths => paths.map(path => path.getAttribute('d')).join('')"
    )  # fmt: skip


def test_the_browser_draws_the_mode_that_is_chosen(table) -> None:  # type: ignore[no-untyped-def]
    """Below its row, with its views; first, before anything is chosen, the first one at rest at its end."""
    row, page = mode_row(), table(reduced_motion="reduce")
    drawing = row.drawing
    assert drawing is not None
    assert page.locator("tr[data-mode]").count() == 2 * len(row.frequency_hz)
    buttons = page.locator("tr[data-mode] button")
    assert buttons.count() == len(row.frequency_hz)
    assert "mode 1:" in page.locator("#mode-viewer").inner_text()
    for mode in range(len(row.frequency_hz)):
        if mode:
            buttons.nth(mode).click()
        assert buttons.nth(mode).get_attribute("aria-expanded") == "true"
        assert page.locator("tr.mode-drawing").evaluate("tr => tr.previousSibling.dataset.mode") == str(mode)
        assert f"mode {mode + 1}: " in page.locator("#mode-viewer").inner_text()
        assert page.locator("#mode-viewer svg").count() == len(drawing.views(mode))
    assert "50 % gear 2, 50 % rod" in page.locator("#mode-viewer").inner_text()
    buttons.nth(mode).click()
    assert page.locator("tr.mode-drawing").count() == 0


def test_the_browser_draws_the_points_to_one_scale(table) -> None:  # type: ignore[no-untyped-def]
    """Pixels are an affine map of the points at the end of the swing, as many to a metre in every direction."""
    drawing, page = mode_row().drawing, table(reduced_motion="reduce")
    assert drawing is not None
    scales = []
    for view, axes in enumerate(drawing.views(0)):
        ends = (drawing.points + drawing.moved[:, :, 0].real)[:, list(axes)]
        expected = np.array(
            [ends[[a, b]] for kind in ("arm", "strut", "mass") for a, b, k in drawing.links if k == kind]
        )
        numbers = [float(number) for number in re.findall(r"-?[\d.]+", sticks(page, view).split("h0")[0])]
        pixels = np.array(numbers)[: expected.size].reshape(expected.shape)
        for axis, sign in ((0, 1), (1, -1)):
            slope, start = np.polyfit(expected[..., axis].ravel(), pixels[..., axis].ravel(), 1)
            line = slope * expected[..., axis] + start
            np.testing.assert_allclose(pixels[..., axis], line, atol=0.2)
            scales.append(sign * slope)
    np.testing.assert_allclose(scales, scales[0], rtol=2e-3)
    assert scales[0] > 50


def test_the_browser_draws_a_slide_that_spans_nothing_upwards(browser, tmp_path) -> None:  # type: ignore[no-untyped-def]
    """All points on one line: a strip along it, no division by its height."""
    joint = Joint("x", "x", Spring(5e6, 300.0), Motor(2e-3, 600.0), motion="translation")
    load = Body("load", "carriage", Placement((0.5, 0, 0)), (Joint("e", "x", Spring(8e5), motion="translation"),), 25)
    drawing = drawn(Robot("slide", (Body("carriage", joints=(joint,), mass=40), load)), np.array([0.3]))
    row = ModeRow("c1", np.arange(1.0, 1.0 + drawing.moved.shape[2]), np.full(2, 0.05), drawing=drawing)
    page, complaints = browser.new_page(), []
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(written(report_content(modes=(row,)), tmp_path).as_uri())
    box = page.locator("#mode-viewer svg").first.bounding_box()
    assert 350 < box["width"] < 420
    assert 100 < box["height"] < 200
    assert "NaN" not in sticks(page)
    assert complaints == []


def test_the_browser_plays_and_pauses(table) -> None:  # type: ignore[no-untyped-def]
    """A chosen mode swings; paused, it stays where it is; at first nothing moves."""
    page = table(reduced_motion="no-preference")
    at_first = sticks(page)
    page.wait_for_timeout(150)
    assert sticks(page) == at_first
    button = page.locator("#mode-viewer button")
    page.locator("tr[data-mode] button").nth(1).click()
    assert button.inner_text() == "Pause"
    seen = set()
    for _ in range(4):
        page.wait_for_timeout(120)
        seen.add(sticks(page))
    assert len(seen) > 1
    button.click()
    assert button.inner_text() == "Play"
    held = sticks(page)
    page.wait_for_timeout(150)
    assert sticks(page) == held
    button.click()
    page.wait_for_timeout(300)
    assert sticks(page) != held


def test_the_browser_moves_nothing_on_its_own_for_those_who_want_it_calm(table) -> None:  # type: ignore[no-untyped-def]
    """prefers-reduced-motion: a chosen mode stands at its end until it is played."""
    page = table(reduced_motion="reduce")
    page.locator("tr[data-mode] button").nth(1).click()
    held = sticks(page)
    page.wait_for_timeout(200)
    assert sticks(page) == held
    page.locator("#mode-viewer button").click()
    page.wait_for_timeout(300)
    assert sticks(page) != held


def test_the_page_without_scripts_and_on_paper_has_the_table_alone(table) -> None:  # type: ignore[no-untyped-def]
    """Plain numbers in the place of the buttons; no drawing that nobody chose on paper."""
    page = table(java_script_enabled=False)
    assert page.locator("tr[data-mode] button").count() == 0
    assert not page.locator("#mode-viewer").is_visible()
    page = table()
    page.emulate_media(media="print")
    assert not page.locator("#mode-viewer").is_visible()


def test_what_a_robot_is_called_cannot_run(browser, tmp_path) -> None:  # type: ignore[no-untyped-def]
    """Names of springs and configurations are text, in the data and on the page."""
    name = "</script><script>document.title='run'</script><img src=x onerror=alert(1)>"
    row = replace(mode_row(name), stores=(name, "rod"))
    page = browser.new_page()
    page.goto(written(report_content(title="safe", modes=(row,)), tmp_path).as_uri())
    assert page.title() == "safe"
    assert "</script>" in page.locator("#mode-viewer").inner_text()
    assert page.locator("#mode-viewer img").count() == 0
    viewer = mode_viewer([row], True)
    assert viewer is not None
    assert json.loads(viewer.data)["rows"][0]["modes"][0]["title"].startswith(name)
