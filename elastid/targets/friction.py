r"""Friction in C: an observer (extended Kalman filter) for each joint, and the compensation torque of each motor.

The observer has one call per sample, which updates the states and the covariance and allocates no memory. Parameters
of the joint and of the noise are constants; torques and angles are link-side values, SI.

The compensation is the friction torque of each motor as a function of velocity, in C and as a table,

.. math:: u_f(v) = g(v) \tanh(v / v_s) + \alpha_3 v |v| + \alpha_2 v

the identified model in steady sliding with viscous friction. v_s = 0.01 rad/s smooths the reversal, so that velocity
noise near 0 does not reverse the torque. Link side, SI.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path

import casadi as ca
import numpy as np

from elastid.base.escape import c_comment, c_identifiers
from elastid.base.statistics import QUANTILE_95
from elastid.friction.robot_friction import frictions
from elastid.friction_study.extended_kalman_filter import TrackedJoint, filter_step, first_estimate
from elastid.friction_study.friction_tracking import TrackedFriction
from elastid.robot import Robot
from elastid.store.files import write_rows, write_text
from elastid.targets.code import c_sources, dense
from elastid.targets.numbers import c_row
from elastid.targets.target import Target
from elastid.use.commanded_robot import SLIDING


def write_observers(folder: Path, observers: Mapping[str, TrackedFriction]) -> tuple[Path, ...]:
    """Write observer.c and observer.h with functions <joint>_start and <joint>_follow for each joint."""
    identifiers = c_identifiers(observers)
    steps = {name: _step(identifiers[name], observer) for name, observer in observers.items()}
    equations = c_sources("equations", steps.values())["equations.c"]
    source, header = folder / "observer.c", folder / "observer.h"
    functions = (_functions(identifiers[name], observer, steps[name]) for name, observer in observers.items())
    write_text(source, "".join([equations, '\n#include "observer.h"\n', *functions]))
    write_text(header, _header(observers, identifiers))
    return source, header


def _step(name: str, observer: TrackedFriction) -> ca.Function:
    """Return the filter step (x, P, u, g, y) -> (x, P, innovation, variance) with the identified noise."""
    step = filter_step(observer.filtered, observer.rate_hz)
    x, P, u, g, y = step.sx_in()[:5]
    results = step(x, P, u, g, y, observer.noise.vector(observer.filtered, observer.rate_hz))
    return dense(f"{name}_step", [x, P, u, g, y], results)


def _functions(name: str, observer: TrackedFriction, step: ca.Function) -> str:
    """Return the C functions <name>_start and <name>_follow of a joint."""
    x, P = first_estimate(observer.filtered, 0.0)
    n, size = len(x), P.size
    angles = [i for i, state in enumerate(observer.filtered.states) if state.startswith("q_")]
    spring = f" - load / {observer.filtered.stiffness!r}" if observer.filtered.stiffness > 0 else ""
    copies = "".join(f"  x[{i}] = angle{spring if observer.filtered.states[i] == 'q_l' else ''};\n" for i in angles)
    return f"""
void {name}_start(double x[{n}], double P[{size}], double angle, double load) {{
  static const double x_start[{n}] = {c_row(x)};
  static const double P_start[{size}] = {c_row(P.ravel(order="F"))};
  for (int i = 0; i < {n}; i++) x[i] = x_start[i];
  for (int i = 0; i < {size}; i++) P[i] = P_start[i];
  (void)load;
{copies}}}

void {name}_follow(double x[{n}], double P[{size}], double torque, double load, double angle, double *innovation,
                   double *variance) {{
  double x_next[{n}], P_next[{size}], w[{step.sz_w()} + 1];
  casadi_int iw[{step.sz_iw()} + 1];
  const double *arg[{step.sz_arg()}] = {{x, P, &torque, &load, &angle}};
  double *res[{step.sz_res()}] = {{x_next, P_next, innovation, variance}};
  {name}_step(arg, res, iw, w, 0);
  for (int i = 0; i < {n}; i++) x[i] = x_next[i];
  for (int i = 0; i < {size}; i++) P[i] = P_next[i];
}}
"""


def _header(observers: Mapping[str, TrackedFriction], identifiers: Mapping[str, str]) -> str:
    lines = [
        "Extended Kalman filters of joint friction, link side, SI. Call <joint>_start once at rest, then",
        "<joint>_follow every sample. torque, load: motor torque and gravity torque since the previous sample.",
        "angle: present motor angle. innovation: measured minus predicted angle. variance: variance of the",
        "innovation. Both may be NULL. The states Fc and f are logarithms. 95 % band of state i, with n states:",
        "x[i] +- 1.96 sqrt(P[i * n + i]). The band includes the errors of the fixed numbers. For each of these,",
        *("P ends with n cross covariances of the states, divided by its standard deviation.", "", "States:", ""),
    ]
    declarations = []
    for name, observer in observers.items():
        states, key = observer.filtered.states, identifiers[name]
        n, size = len(states), len(states) * (len(states) + len(observer.filtered.consider_parameters))
        meanings = ", ".join(f"x[{i}] {state}" for i, state in enumerate(states))
        lines.append(f"{name} ({key}) at {observer.rate_hz:g} Hz: {meanings}")
        stds = [f"{name} {observer.filtered.tolerances[name]:.2g}" for name in observer.filtered.consider_parameters]
        lines += [f"  fixed, with relative std: {', '.join(stds) or 'nothing'}"]
        lines += [f"  starts with 95 % bands {_initial_bands(observer.filtered)}"]
        declarations.append(f"void {key}_start(double x[{n}], double P[{size}], double angle, double load);")
        declarations.append(
            f"void {key}_follow(double x[{n}], double P[{size}], double torque, double load, double angle,\n"
            f"{' ' * (len(key) + 13)}double *innovation, double *variance);"
        )
    return c_comment(lines) + "\n".join(["#ifndef OBSERVER_H", "#define OBSERVER_H", *declarations, "#endif"]) + "\n"


def _initial_bands(joint: TrackedJoint) -> str:
    bands, (x, P) = list[str](), first_estimate(joint, 0.0)
    std = np.sqrt(np.diag(P))
    for i, state in enumerate(joint.states):
        if state in joint.followed:
            ends = x[i] + QUANTILE_95 * std[i] * np.array([-1, 1])
            low, high = ends if state == "offset" else np.exp(ends)
            bands.append(f"{state} {low:.4g} to {high:.4g}")
    return ", ".join(bands)


def compensation(robot: Robot) -> ca.Function:
    """Return the function v (n_u,) -> u_f (n_u,), the friction torque of each motor, link side."""
    v = ca.SX.sym("v", robot.n_u)
    laws = {law.place: law for law in frictions(robot)}
    torques = []
    for i, joint in enumerate(robot.driven):
        is_flexible = joint in robot.flexible
        locations = [f"motor {joint.name}", *([] if is_flexible else [f"joint {joint.name}"])]
        total = (joint.all_viscous - is_flexible * joint.viscous) * v[i]
        for law in (laws[location] for location in locations if location in laws):
            curve = law.symbols(law.curve().tolist())
            total += curve.torque(v[i]) * ca.tanh(v[i] / SLIDING) + curve.growing(v[i])
        torques.append(total)
    return dense("friction", [v], [ca.vertcat(*torques)])


def write_compensation(folder: Path, robot: Robot, title: str, known: Iterable[str]) -> tuple[Path, ...]:
    """Write friction.c and .h with `friction_torque(v, u)`, and friction.csv.  known: lines on the intervals."""
    function, m = compensation(robot), robot.n_u
    entries = ", ".join(f"[{i}] motor {joint.name}" for i, joint in enumerate(robot.driven))
    lines = [f"{title}: friction_torque, the torque u of the motors' friction at velocities v, link side, SI.", entries]
    comment = c_comment([*lines, *known])
    equations = c_sources("equations", [function])["equations.c"]
    call = f"""
#include "friction.h"

void friction_torque(const double v[{m}], double u[{m}]) {{
  double w[{function.sz_w()} + 1];
  casadi_int iw[{function.sz_iw()} + 1];
  const double *arg[{function.sz_arg()} + 1] = {{v}};
  double *res[{function.sz_res()} + 1] = {{u}};
  friction(arg, res, iw, w, 0);
}}
"""
    header = (
        f"#ifndef FRICTION_H\n#define FRICTION_H\nvoid friction_torque(const double v[{m}], double u[{m}]);\n#endif\n"
    )
    source, header_file, table = (folder / f"friction.{end}" for end in ("c", "h", "csv"))
    write_text(source, comment + equations + call)
    write_text(header_file, comment + header)
    write_rows(table, [("motor", "velocity", "torque"), *_rows(robot, function)])
    return source, header_file, table


def _rows(robot: Robot, function: ca.Function) -> Iterable[tuple[str, float, float]]:
    # Without a velocity limit the table ends at 3 rad/s (m/s).
    fastest = [joint.limits.velocity if np.isfinite(joint.limits.velocity) else 3.0 for joint in robot.driven]
    # Denser near zero velocity, where friction reverses.
    v = np.outer(fastest, np.sinh(np.linspace(-6, 6, 201)) / np.sinh(6))
    u = function.map(v.shape[1])(v).full()
    for joint, speeds, torques in zip(robot.driven, v.tolist(), u.tolist(), strict=True):
        yield from ((joint.name, speed, torque) for speed, torque in zip(speeds, torques, strict=True))


TARGETS = (
    Target(
        "observer", ("observers",), "friction observer (extended Kalman filter) of each joint, in C", write_observers
    ),
    Target(
        "compensation",
        ("robot", "title", "known"),
        "motor friction torque as a function of velocity, in C",
        write_compensation,
    ),
)
