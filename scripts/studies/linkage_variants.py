"""How far approximate models of a parallel linkage are off, on the shipped planar arm, against the exact model.

    python scripts/studies/linkage_variants.py [--quick] [--figure PATH]

Main modes: the two lowest undamped natural frequencies in six configurations, sin of the angle between lever and rod
0.5 to 1; largest errors of f1 and f2. `best fit`: the springs that the variant knows, fitted to these frequencies of
the exact model; what that makes of them is printed. Bending: the lower arm bends inside the loop; rms error of the
frequency response, 5 to 30 Hz, for loops that ignore the bending and for a lower arm that does not bend, on the
parallelogram and on a four-bar with a longer crank. --figure: the errors over the angle as a picture.  The last line
is one JSON object with the numbers of the tables.

What a loop that ignores bending misses is that the upper arm turns as the lower one bends, which it does not in a
parallelogram: 3 % there against 44 % without bending, 24 % on the four-bar against 36 %.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypedDict

import numpy as np
from pydantic import TypeAdapter
from ruamel.yaml import YAML
from scipy.linalg import eigh
from scipy.optimize import least_squares

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec, Variant
from elastid.record import Configuration
from elastid.robot import Robot

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "linkage_arm.yml"
# Angle between lever and rod off 90 degrees; the crank is at the lower arm's angle plus it.
OFF = (0.0, -0.3, 0.5, 0.8, -0.8, 1.05)
LOWER = (0.0, 0.3, -0.4, 0.1, 0.5, -0.2)
NO_BENDING = 1e12


class Row(TypedDict):
    """One variant: largest errors of f1 and f2, what a fit makes of its springs, its frequencies (6, 2)."""

    f1_f2_percent: list[float]
    bias_percent: dict[str, float]
    f_hz: list[list[float]]


def arm(**values: float) -> Robot:
    """The shipped arm with other numbers."""
    data = YAML(typ="safe").load(ROBOT.read_text(encoding="utf-8"))
    robot: Robot = TypeAdapter(Robot).validate_python(data).with_parameters(values)
    return robot


def four_bar() -> Robot:
    """The shipped arm with a crank of 330 mm and a rod of 870 mm instead of the parallelogram."""
    robot = arm()
    (loop,) = robot.loops
    assert loop.rod is not None
    ends = (replace(loop.ends[0], point=(-0.33, 0.0, 0.0)), loop.ends[1])
    return replace(robot, loops=(replace(loop, ends=ends, rod=replace(loop.rod, length=0.87)),))


def configurations() -> list[Configuration]:
    """Six of them."""
    each = zip(LOWER, OFF, strict=True)
    return [Configuration(f"c{i}", np.array([q2, q2 + off])) for i, (q2, off) in enumerate(each, start=1)]


def main_modes(robot: Robot, variant: Variant, values: dict[str, float] | None = None) -> FloatArray:
    """f1 and f2 (6, 2) in Hz, undamped, above the gravity modes."""
    model = formulate(robot, ModelSpec("minimal", variant))
    linearisation, theta = Linearisation.of(model), np.array(model.theta)
    for name, value in (values or {}).items():
        theta[model.parameters.index(name)] = value
    found = []
    for at in configurations():
        linear = linearisation.at(at, theta, model.inputs, "acceleration")
        squares = eigh(linear.K, linear.M, eigvals_only=True)
        frequencies = np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)
        found.append(frequencies[frequencies > 5.0][:2])
    return np.array(found)


def fitted(robot: Robot, variant: Variant, names: Sequence[str], exact: FloatArray) -> dict[str, float]:
    """The springs with which a variant comes nearest to the exact frequencies."""
    start = np.array([dict(robot.parameters())[name][0] for name in names])

    def error(x: FloatArray) -> FloatArray:
        values = dict(zip(names, start * np.exp(x), strict=True))
        return np.asarray(np.log(main_modes(robot, variant, values) / exact).ravel())

    x = least_squares(error, np.zeros(len(names)), x_scale=0.1, diff_step=1e-4, xtol=1e-6).x
    return dict(zip(names, (start * np.exp(x)).tolist(), strict=True))


def largest(f: FloatArray, exact: FloatArray) -> list[float]:
    """The error of f1 and f2 that is largest over the configurations, in %, with its sign."""
    error = 100 * (f / exact - 1)
    return [float(column[np.argmax(np.abs(column))]) for column in error.T]


def frequency_table(quick: bool) -> dict[str, Row]:
    """Errors of f1 and f2 of each variant, and what a fit makes of the springs."""
    robot = arm(k_b2=NO_BENDING)
    exact = main_modes(robot, "exact")
    rows: dict[str, Row] = {}

    def add(name: str, f: FloatArray, found: dict[str, float] | None = None) -> None:
        true = {key: dict(robot.parameters())[key][0] for key in found or {}}
        bias = {key: 100 * (value / true[key] - 1) for key, value in (found or {}).items()}
        f1, f2 = largest(f, exact)
        rows[name] = Row(f1_f2_percent=[f1, f2], bias_percent=bias, f_hz=f.tolist())
        words = ", ".join(f"{key} {value:+.1f} %" for key, value in bias.items())
        print(f"  {name:34}{f1:+8.2f} %{f2:+8.2f} %  {words}")

    print("largest error of the two main modes over six configurations")
    add("rigid loop", main_modes(robot, "rigid_loop"))
    constant: tuple[str, ...] = ("k_3",) if quick else ("k_2", "k_3")
    found = fitted(robot, "rigid_loop", constant, exact)
    add("one constant stiffness, best fit", main_modes(robot, "rigid_loop", found), found)
    add("series stiffness", main_modes(robot, "series_stiffness"))
    if not quick:
        found = fitted(robot, "series_stiffness", ("k_2", "k_3", "k_rod"), exact)
        add("series stiffness, best fit", main_modes(robot, "series_stiffness", found), found)
    add("massless rod", main_modes(robot.with_parameters({"m_rod": 0.0, "I_rod": 0.0}), "exact"))
    add("rod's mass at its ends", main_modes(robot, "lumped_rod"))
    return rows


def bending_table() -> dict[str, list[float]]:
    """rms error of the response in %, 5 to 30 Hz: bending outside the loop, and no bending."""
    freq_hz = np.linspace(5, 30, 100)
    table = {}
    print("rms error of the response, 5 to 30 Hz: bending that the loop does not see; no bending")
    for name, robot in (("parallelogram", arm()), ("four-bar", four_bar())):
        outside, none = [], []
        rigid = robot.with_parameters({"k_b2": NO_BENDING})
        for at in [at for at, off in zip(configurations(), OFF, strict=True) if abs(off) < 0.9]:
            exact = response(robot, at, freq_hz, "exact")
            outside.append(rms(response(robot, at, freq_hz, "bending_outside"), exact))
            none.append(rms(response(rigid, at, freq_hz, "exact"), exact))
        table[name] = [max(outside), max(none)]
        print(f"  {name:34}{table[name][0]:8.2f} %{table[name][1]:8.2f} %")
    return table


def response(robot: Robot, at: Configuration, freq_hz: FloatArray, variant: Variant) -> ComplexArray:
    """Motor acceleration per torque, complex."""
    model = formulate(robot, ModelSpec("minimal", variant))
    linear = Linearisation.of(model).at(at, model.theta, model.inputs, "acceleration")
    return frequency_response(linear, linear.theta_ref, freq_hz)


def rms(G: ComplexArray, exact: ComplexArray) -> float:
    """Relative to the exact response, in %."""
    return float(100 * np.linalg.norm(G - exact) / np.linalg.norm(exact))


def draw(rows: dict[str, Row], path: Path) -> None:
    """Errors of f1 over the sine of the angle between lever and rod."""
    from matplotlib.figure import Figure

    exact = main_modes(arm(k_b2=NO_BENDING), "exact")
    figure = Figure(figsize=(7, 4), layout="constrained")
    axes = figure.subplots()
    sines = np.cos(OFF)
    order = np.argsort(sines)
    for name, row in rows.items():
        error = 100 * (np.array(row["f_hz"])[:, 0] / exact[:, 0] - 1)
        axes.plot(sines[order], error[order], "o-", label=name)
    axes.set(xlabel="sin of the angle between lever and rod", ylabel="error of the first mode, %")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer fits")
    parser.add_argument("--figure", type=Path, help="where to draw the errors")
    arguments = parser.parse_args()
    rows = frequency_table(arguments.quick)
    bending = bending_table()
    if arguments.figure is not None:
        draw(rows, arguments.figure)
    print(json.dumps({"main_modes": rows, "bending_rms_percent": bending}))


if __name__ == "__main__":
    main()
