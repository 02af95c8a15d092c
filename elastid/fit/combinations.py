"""Correlated parameters: indistinguishable pairs, and combinations that are identifiable."""

from collections.abc import Iterator, Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import digits, number
from elastid.base.errors import Note
from elastid.base.statistics import QUANTILE_95, correlation_of, identifiable_combinations
from elastid.fit.result import Result
from elastid.record import JointLoop
from elastid.robot import Robot, channel_name

MAX_CORRELATION = 0.99  # correlation above which two parameters are indistinguishable
COMBINATION = "fit/combination"
MIN_RELATIVE_STD = 0.25  # of a parameter whose combination with others is reported


def conditional_covariance(C: FloatArray, n: int) -> FloatArray:
    """Return C_xx - C_xn C_nn^-1 C_nx (n, n), the conditional covariance of the first n variables given the others."""
    cross = C[:n, n:]
    if not np.isfinite(C).all():  # unidentifiable parameters
        return C[:n, :n].copy()
    return C[:n, :n] - cross @ np.linalg.solve(C[n:, n:], cross.T)


def correlated_combinations(names: Sequence[str], covariance: FloatArray) -> Iterator[Note]:
    """Yield a note for each indistinguishable pair.  covariance: by noise alone, since model errors correlate all."""
    correlation = np.triu(np.nan_to_num(correlation_of(covariance)), 1)
    for i, j in np.argwhere(np.abs(correlation) > MAX_CORRELATION):
        text = f"{names[i]} and {names[j]} are indistinguishable (correlation {correlation[i, j]:.4f}). Fix one of them"
        yield Note("fit/correlated", text)


def combination_notes(result: Result) -> Iterator[Note]:
    """Yield a note for each pair or triple of weakly identified parameters with a well identified combination."""
    names, std, values = result.parameters.free_names, result.std, result.values
    x, scale = np.array([values[name] for name in names]), np.array([std[name] for name in names])
    correlation = result.covariance / np.sqrt(np.outer(*[np.diag(result.covariance)] * 2))
    for combination in identifiable_combinations(x, correlation * np.outer(scale, scale)):
        members = [names[i] for i in combination.members]
        relative = [std[name] / max(abs(values[name]), 1e-300) for name in members]
        if max(relative) < MIN_RELATIVE_STD:
            continue
        terms = (
            f"{'-' if w < 0 else '+'} {abs(w):.2g} {name}"
            for w, name in zip(combination.weights[1:], members[1:], strict=True)
        )
        unit = result.parameters[members[0]].unit
        singles = ", ".join(f"{name} {x:.0%}" for name, x in zip(members, relative, strict=True))
        interval = f"{_interval(combination.value, combination.std)} {unit} (95 % interval)"
        text = (
            f"only the combination {' '.join([members[0], *terms])} = {interval} is well identified. Relative std of "
            f"each parameter: {singles}. To separate them, add a configuration, an output or a wider band"
        )
        yield Note(COMBINATION, text, severity="information")


def loop_note(result: Result, robot: Robot, loop: JointLoop) -> tuple[Note, ...]:
    r"""Report the sum of velocity gain and viscous friction of each motor, link side, for responses to references.

    With torque u = k_p (r - q) - k_d q' both act as (k_d + n^2 f_m) q', where n is the gear ratio: an error of the
    stated k_d biases f_m. A free gain is included with its covariance.
    """
    phrases, sensitive = list[str](), list[str]()
    names, values, std = result.parameters.free_names, result.values, result.std
    for joint, k_d in zip(robot.driven, loop.kd.tolist(), strict=True):
        of_friction, of_gain = f"fm_{joint.name}", channel_name("gain", "kd", f"motor {joint.name}")
        if of_friction not in names or joint.motor is None or robot.gears:
            continue
        slopes = {of_friction: joint.motor.ratio**2, of_gain: k_d}
        members = [name for name in slopes if name in names]
        index = [names.index(name) for name in members]
        scale = np.array([slopes[name] * std[name] for name in members])
        C = result.covariance[np.ix_(index, index)]
        C = C / np.sqrt(np.outer(np.diag(C), np.diag(C))) * np.outer(scale, scale)
        value = slopes[of_friction] * values[of_friction] + k_d * values.get(of_gain, 1.0)
        unit = "N*s/m" if joint.slides else result.parameters[of_friction].unit
        phrases.append(f"{_interval(value, float(np.sqrt(C.sum())))} {unit} (motor {joint.name})")
        if of_gain not in names:
            sensitive.append(f"{100 * slopes[of_friction] * std[of_friction] / k_d:.2g} % (motor {joint.name})")
    if not phrases:
        return ()
    text = f"identified: velocity_gain + ratio^2 fm = {', '.join(phrases)} (link side, 95 % interval)"
    text += ", with any Coulomb friction"
    if sensitive:
        text += (
            f". fm alone assumes an exact velocity_gain: an error of {', '.join(sensitive)} changes fm by one std. To "
            "identify velocity_gain and fm separately, log the motor torques"
        )
    return (Note(COMBINATION, text, severity="information"),)


def _interval(value: float, std: float) -> str:
    return f"{number(value, digits(value, std))} +- {number(QUANTILE_95 * std, 2)}"
