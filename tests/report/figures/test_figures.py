"""Figures: what each draws are the numbers of its result, and each can be read."""

import math
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from plants import friction_study as study
from plants.arm import result
from plants.dry_friction import robot
from plants.published_friction import drawn, published_levels
from plants.report_values import TRUTH, balance, fit_result, pair
from plants.taken_friction import taken_friction

from elastid.base.statistics import QUANTILE_95
from elastid.design.forecast import Forecast
from elastid.design.limit_use import QUANTITIES, LimitUse
from elastid.friction_study.spec import LawSpec
from elastid.friction_study.static_model_fit import StaticLaw
from elastid.nonlinear.friction_basis import BasisFunction
from elastid.nonlinear.gear_result import GearNumber, GearResult, GearSheet
from elastid.report.figures import fit, friction, friction_records, use
from elastid.report.parameter_row import parameter_rows
from elastid.response import LineAmplitudes, Quality
from elastid.robot import Body, Joint, Motor, Robot, Spring
from elastid.use.map import map_workspace
from elastid.validation.fleet import FleetValue
from elastid.validation.log_comparison import DRY, INERTIA

# A figure, and panel by panel values by label: of curves, bars and bands, and of a heat map under "".
Drawn = tuple[Figure, list[dict[str, Any]]]


def about(y: Any, std: Any) -> np.ndarray:
    """Both ends of 95 % intervals."""
    return np.stack([y - QUANTILE_95 * std, y + QUANTILE_95 * std])


def decibel(values: Any) -> np.ndarray:
    return 20 * np.log10(np.abs(values))


def shown(axes: Axes, column: int = 1) -> dict[str, np.ndarray]:
    """Values along y, or x, of all that a panel draws, by label."""
    bars = {part: each.get_label() for each in axes.containers for part in (each[0], *each[2])}
    values = {"": [np.ravel(image.get_array().filled(np.nan)) for image in axes.images]}
    for part in (*axes.lines, *axes.collections):
        paths = part.get_paths() if isinstance(part, Collection) else [part.get_path()]
        text = str(bars.get(part, part.get_label()))
        if part.get_transform() == axes.transData:
            vertices = np.concatenate([path.vertices for path in paths])
            values.setdefault("" if text.startswith("_") else text, []).append(vertices[:, column])
    joined = {label: np.concatenate(parts) for label, parts in values.items() if parts}
    return {label: numbers[np.isfinite(numbers)] for label, numbers in joined.items()}


def parameters(truth: dict[str, float] | None = None) -> Drawn:
    """Ratios to the truth, else to the estimate, and deviations from it in percent, of which more is to the right."""
    rows = parameter_rows(fit_result(), truth)
    estimate, low, high, start = np.array([(row.estimate, *row.interval, row.start) for row in rows]).T
    known, is_free = estimate if truth is None else np.array([*truth.values()]), np.arange(4) != 2
    ratio, percent = (
        {"estimate": by(estimate)[is_free], "95 % interval": [by(low), by(high)]}
        | ({} if truth is None else {"truth": by(known)})
        for by in (lambda v: v / known, lambda v: 100 * (v - known) / np.abs(known))
    )
    return fit.forest(rows), [ratio | {"start": start / known, "bound": 250 / known[2]}, percent]


def identifiability() -> Drawn:
    r = fit_result()
    std = np.sqrt(np.diag(r.covariance))
    return fit.identifiability(r), [{"": r.covariance / np.outer(std, std)}]


def information() -> Drawn:
    """Fractions in percent by octave, the mean over the parameters."""
    share = np.random.default_rng(0).dirichlet(np.ones(8), 3).T.reshape(2, 4, 3)
    freq_hz = np.array([2.0, 10.0, 40.0, 40.1])
    of = Forecast(("k", "d", "m"), ("",) * 3, np.ones(3), (True,) * 3, np.eye(3), ("a", "b"), freq_hz, share, ())
    octaves, lines = np.zeros((2, 5)), share.mean(axis=2)  # from 2, 4, 8, 16 and 32 Hz
    octaves[:, [0, 2, 4]] = np.column_stack([lines[:, :2], lines[:, 2:].sum(axis=1)])
    return fit.information(of), [{"": 100 * octaves}]


def limits() -> Drawn:
    """Torque uses 80 % and 10 %, velocity has a limit for one motor."""
    peak, limit = np.ones((1, len(QUANTITIES), 2)), np.full((1, len(QUANTITIES), 2), np.inf)
    limit[0, 0], limit[0, 2, 0] = (1.25, 10.0), 2.0
    figure = fit.limit_use(LimitUse(("c1",), ("motor 1", "motor 2"), peak, limit, np.ones((1, 2)), 0.1))
    return figure, [{"": [[80.0, 10.0]]}, {"": [50.0]}]


def hysteresis(slides: bool) -> Drawn:
    """A loop of a gear of 2e5 Nm/rad, to and fro; in arcmin, of a joint that slides in mm."""
    torque = 300 * np.r_[-1:1:50j, 1:-1:50j]
    straight, std = torque / 2e5, np.linspace(1e-6, 2e-6, 100)
    loop = 1e-5 * np.repeat([1.0, -1.0], 50)
    k = GearNumber("k_1", "stiffness", "stiffness", "N*m/rad", 2e5, 200.0)
    sheet = GearSheet("1", (k,), 300.0, torque, straight + loop, std)
    joint = Joint("1", "z", Spring(2e5), Motor(0.1, 1.0), motion="translation" if slides else "rotation")
    figure = fit.hysteresis(
        GearResult(np.zeros(0), np.zeros((0, 0)), sheets=(sheet,)),
        Robot("arm", (Body("a", joints=(joint,), mass=9.0),)),
    )
    factor = 1e3 if slides else 60 * 180 / math.pi
    above, below = (
        {"torsion, to and fro": factor * y, "95 % band": factor * about(y, std)} for y in (straight + loop, loop)
    )
    return figure, [above | {"k at zero torque": factor * straight}, below]


def bode(modelled: bool) -> Drawn:
    """Magnitude in dB and phase in degrees of each element; dots are grey below two sigma."""
    measured, model = (replace(G, G=np.exp(-0.15j * G.freq_hz)[:, None, None] * G.G) for G in pair(2))
    std, panels = 0.01 * np.abs(model.G), []
    std[3] *= 100.0
    above = np.abs(measured.G) >= 2 * np.sqrt(measured.noise.variance)
    for i, y in ((i, y) for i in range(2) for y in (decibel, partial(np.angle, deg=True))):
        for j in range(2):
            panels.append({"measured": y(measured.G[above[:, i, j], i, j])})
            if modelled:
                panels[-1]["model"] = y(model.G[:, i, j])
            if modelled and y is decibel:
                size, reach = np.abs(model.G[:, i, j]), 2 * std[:, i, j]
                panels[-1]["2 std of the model"] = decibel([np.maximum(size - reach, size / 1000), size + reach])
    return fit.bode(measured, model if modelled else None, std), panels


def quality() -> Drawn:
    """Amplitudes, of lines that were not excited without their noise; what no input explains; singular values."""
    response, _ = pair(2)
    f = response.freq_hz
    noise, stochastic, multiple, G, u = np.random.default_rng(0).uniform(0.1, 0.9, (5, len(f), 2))
    G, u = (np.sort(values)[:, ::-1] for values in (G, u))
    excited, even, odd = (LineAmplitudes(f, size * noise, noise) for size in (10.0, 2.0, 3.0))
    of = Quality(np.ones((len(f), 2, 2)), multiple, G, u, noise, noise, excited, stochastic, even, odd)
    sizes = {"excited lines": 10, "noise": 1, "nonlinear, even": math.sqrt(3), "nonlinear, odd": math.sqrt(8)}
    panels = [
        {label: decibel(size * noise[:, i]) for label, size in sizes.items()}
        | {"stochastic nonlinear": decibel(stochastic[:, i])}
        for i in range(2)
    ]
    return fit.quality_figure(response, of, "c1"), [*panels, {"": 1 - multiple}, {"": decibel(G)}, {"": decibel(u)}]


def torque() -> Drawn:
    """Torque, its parts, and what is left by octave in percent."""
    of = balance()
    whole = {"measured": of.measured, "model without friction": of.torques[0], "measured − model": of.residual}
    names = ("unexplained_fraction", "unexplained_without_friction", "power")
    texts = ("unexplained", "unexplained without friction", "fraction of the torque's power")
    shares = dict(zip(texts, names, strict=True))
    left = {text: [100 * max(getattr(each, name), 1e-7) for each in of.bands] for text, name in shares.items()}
    model = {"model": of.torques.sum(axis=0)}
    return fit.torque_balance_figure(of), [whole | model, {INERTIA: of.torques[0], DRY: of.torques[1]}, left]


def fleet() -> Drawn:
    """Two dates of twenty robots, of which one differs."""
    values = [FleetValue(f"cell {i:02} west", day, "k_1", i + day, 0.1) for i in range(20) for day in (0.0, 1.0)]
    y = np.arange(20)[:, None] + [0.0, 1.0]
    rows = {"differs or drifts": y[1], "robot, dates from left to right": np.delete(y, 1, axis=0)}
    panel = {label: [numbers, *about(numbers, 0.1)] for label, numbers in rows.items()}
    return fit.fleet_parameter("k_1", "N*m/rad", values, {"cell 01 west"}), [panel]


def law(levels: Any) -> Drawn:
    """Levels, those of other conditions apart, and what the law leaves of them in standard deviations."""
    heat, y = np.median(levels.temperature), levels.torque
    mine = (levels.load == levels.load.min()) & (np.isnan(heat) | (levels.temperature == heat))
    panel = {}
    for d, name in ((1.0, "positive direction"), (0.0, "both directions"), (-1.0, "negative direction")):
        for label, chosen in (("runs at other loads and temperatures", ~mine), (f"runs, {name}", mine)):
            if (rows := chosen & (levels.direction == d)).any():
                panel[label] = [y[rows], *about(y[rows], levels.std[rows])]
    found = StaticLaw.of(levels, LawSpec())
    return friction.friction_curve(found), [panel, {"": (y - found.torque(levels.conditions)) / levels.std}]


def taken_out(*shapes: BasisFunction) -> Drawn:
    """After a reversal out of sliding, or in sliding where no bristle is; both signs of the file's law; amplitudes."""
    of, n = taken_friction(), len(shapes)
    found = replace(of, shapes=shapes, coulomb_torque=of.coulomb_torque[:n], covariance=of.covariance[:n, :n])
    is_bristle, x = shapes[-1].kind == "stop", np.linspace(-1, 1, 400) * (5 * shapes[0].threshold or 1e-3)
    y, std = found.reversal("motor 1", np.linspace(0, 8e-3, 400)) if is_bristle else found.sliding("motor 1", x)
    panel = {"friction": y, "95 % interval": about(y, std), "F_c of the robot model": [4.0, -4.0]}
    labels = ("before compensation", "after compensation")
    panels = [dict(zip(labels, (found.before[:, i], found.after[:, i]), strict=True)) for i in range(2)]
    return friction.compensation_figure(found, robot((4.0, 7.0))), [panel, *panels]


POSTURES = np.array([[0.2, 0.4], [-0.7, 1.1], [0.9, -0.5], [0.1, 0.05]])
CASES = {
    "parameters": partial(parameters, TRUTH),
    "parameters without a truth": parameters,
    "correlation": identifiability,
    "information": information,
    "limits": limits,
    "gear": partial(hysteresis, False),
    "rail": partial(hysteresis, True),
    "bode": partial(bode, True),
    "measured": partial(bode, False),
    "quality": quality,
    "torque": torque,
    "fleet": fleet,
    "law": lambda: law(study.levels()),
    "conditions": lambda: law(drawn(published_levels(loads=(0.0, 1.0), temperatures=(33.0, 62.0, 80.0)), 1)),
    "sign": partial(taken_out, BasisFunction("motor 1", "sign")),
    "oil": partial(taken_out, BasisFunction("motor 1", "sign", 0.01)),
    "bristle": partial(taken_out, *taken_friction().shapes),
    "motion": lambda: (friction_records.friction_motion(study.motion()), [{}, {}]),
    "map": lambda: (use.workspace_figure(map_workspace(result(), POSTURES, name="arm")), [{}, {}]),
}


@pytest.mark.parametrize("name", CASES)
def test_figure_draws_its_numbers_legibly(name: str, monkeypatch: Any) -> None:
    """No text covers another or leaves the figure; the legend has the labels, panels hold their lines."""
    figure, expected = CASES[name]()
    texts = []
    monkeypatch.setattr(RendererAgg, "draw_text", lambda *_, mtext=None, **__: texts.append(mtext))
    FigureCanvasAgg(figure).draw()
    panels, labels = [axes for axes in figure.axes if axes.axison and axes.get_label() != "<colorbar>"], set()
    for axes, panel in zip(panels, expected, strict=True):
        values = shown(axes, 0 if name.startswith("parameters") else 1)
        for label, known in panel.items():
            apart = np.abs(values[label][:, None] - np.ravel(known))
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) <= 1e-9 * np.abs(known).max(), label
        labels |= values.keys() - {""}
        low, high = sorted(axes.get_ylim())
        for y in (line.get_ydata() for line in axes.lines if line.get_transform() == axes.transData):
            assert low <= np.nanmin(y) <= np.nanmax(y) <= high
        for text in axes.texts if axes.images else ():  # in a cell, to its last digit
            value = axes.images[0].get_array()[text.get_position()[::-1]]
            last = 0.501 * 10.0 ** -len(text.get_text().partition(".")[2])
            assert not text.get_text() or float(text.get_text()) == pytest.approx(value, abs=last)
    assert {text.get_text() for legend in figure.legends for text in legend.get_texts()} == labels
    boxes = {text: text.get_window_extent() for text in texts if text is not None}
    for text, box in boxes.items():
        assert np.all((box.min >= 0) & (box.max <= figure.bbox.max)), text
    for pair_of in combinations(boxes, 2):
        over = Bbox.intersection(*(boxes[text] for text in pair_of))
        assert over is None or min(over.size) < 3, pair_of


def test_cells_have_their_numbers_where_these_say_something() -> None:
    """Fractions from 0.5 %, correlations beyond 0.9 off the diagonal, limits that there are."""
    for case, counts in ((information, [6]), (limits, [2, 1]), (identifiability, [2])):
        assert [len([*filter(Text.get_text, axes.texts)]) for axes in case()[0].axes] == counts


def test_dates_are_around_robot_name() -> None:
    x = shown(fleet()[0].axes[0], 0)
    assert np.unique(x["differs or drifts"].round(9)).tolist() == [0.85, 1.15]


def test_distant_estimate_is_marked_at_its_side() -> None:
    """The others, and their intervals, stay apart on a scale of decades about 0; what has no end is drawn, too."""
    deviation = fit.forest(parameter_rows(fit_result(), TRUTH | {"k_2": 3e4})).axes[1]
    low, high = deviation.get_xlim()
    (x,) = shown(deviation, 0)["estimate off the scale"]
    assert 0.8 * high < x < high == -low < 900
    ticks = deviation.get_xticks()
    np.testing.assert_allclose(ticks, -ticks[::-1])
    np.testing.assert_allclose(np.log10(ticks[ticks > 0]) % 1, 0, atol=1e-9)
    unreachable = replace(fit_result(), covariance=np.diag([1e-4, 1e-4, 1e-4, np.inf]))
    for fitted, truth in ((unreachable, None), (replace(fit_result(), x=np.zeros(4)), {"x_c": 0.0})):
        fit.forest(parameter_rows(fitted, truth)).draw_without_rendering()


def test_a_motion_shows_friction_without_inertia_and_its_regression() -> None:
    """20 N and 200 N s/m under 400 N of inertia; the curve has both directions and ends where the motion does."""
    over_v, over_t = friction_records.friction_motion(study.motion()).axes
    v, force, of_time = shown(over_v, 0), shown(over_v), shown(over_t)
    for label, within in (("", 2.0), ("regression", 0.5)):
        fast = np.abs(v[label]) > 0.3
        known = 20 * np.sign(v[label]) + 200 * v[label]
        np.testing.assert_allclose(force[label][fast], known[fast], atol=within)
    moved = over_v.lines[0].get_xdata()
    assert (v["regression"].min(), v["regression"].max()) == (moved.min(), moved.max())
    np.testing.assert_allclose(of_time["measured − regression"], of_time["measured"] - of_time["regression"])
