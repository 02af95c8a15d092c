"""Answers of the commands map, tune and loops in sentences and tables."""

import numpy as np

from elastid.base.display import Answer, Display, capitalise, degrees, number, percent
from elastid.report.figures.use import DISPLAY_UNITS
from elastid.use.closed_loops import LIMIT_DB
from elastid.use.loops import Loops, LoopState
from elastid.use.map import N_SOFTEST, WorkspaceMap
from elastid.use.moves import KINDS
from elastid.use.tune import TunedMove


def answer_of_map(workspace: WorkspaceMap) -> Answer:
    """Describe the compliance of the robot: softest postures, and contributions of the springs."""
    m = workspace.sample
    C, order = m["softest_compliance"], m.softest
    soft, stiff = int(order[0]), int(order[-1])
    position = ", ".join(number(float(c), 3) for c in m.position[soft])
    fraction, force = float(m.compliance_fraction[soft].max(initial=0.0)), ", ".join(f"{F:g}" for F in m.load)
    softest = [
        (
            str(int(m.asked[i]) + 1), degrees(m.angles[i].tolist(), m.sliding), _value(C.value[i], "m/N"),
            f"{100 * float(C.relative_std[i]):.2g} %", ", ".join(f"{c:.2f}" for c in m.axes[i, :, 0].tolist()),
            _value(m["frequency_1"].value[i], "Hz"), _value(m["depth_of_cut"].value[i], "m"), m.limiting_springs[i],
        )
        for i in order[:N_SOFTEST].tolist()
    ]  # fmt: skip
    limiting, tenth = np.array(m.limiting_springs), order[: max(1, len(m) // 10)]
    springs = [
        (float(m.compliance_fraction[tenth, i].mean()), name, float(np.mean(limiting == name)))
        for i, name in enumerate(m.springs)
    ]
    exclusions = f"; {len(m.refused)} postures without equilibrium excluded" if len(m.refused) else ""
    answers = (
        ("Where is it soft?", (
            f"{len(workspace)} postures: {_value(C.value[stiff], 'm/N')} to {_value(C.value[soft], 'm/N')} in the "
            f"softest direction. Softest: posture {m.asked[soft] + 1} with {m.frame} at ({position}) m{exclusions}.",
        )),
        ("What limits it, and what helps?", (
            f"The stiffness of {m.limiting_springs[soft]}: 1 % more reduces the compliance in the softest posture "
            f"by {fraction:.2g} %.",
        )),
        ("What next?", ("Cut along the stiff direction, in postures with a large chatter-free depth.",)),
    )  # fmt: skip
    fixed = f"No spring moves the origin of {m.frame} in any posture. Map a frame off the axes (--frame)."
    return Answer(
        f"Map of {m.name}",
        answers if C.value[soft] > np.finfo(float).eps else (("Where is it soft?", (fixed,)),),
        (
            Display(
                "The softest postures",
                ("posture", "joints", "softest compliance", "std", "direction x, y, z", "first frequency",
                 "depth of cut", "limited by"),
                softest,
            ),
            Display(
                "Springs", ("spring", "limits", "part"),
                [(name, percent(limits), percent(fraction)) for fraction, name, limits in sorted(springs)[::-1]],
            ),
        ),
        (
            "Limits: fraction of postures in which the spring contributes most to the softest direction. Part: % less "
            f"compliance per % more stiffness of the spring, mean of the softest tenth of {len(m)} postures; "
            f"with gravity the parts do not sum to 100 %. Load ({force}) N; cutting "
            f"coefficient {1e-6 * m.cutting_coefficient:g} N/mm².",
        ),
    )  # fmt: skip


def _value(value: float, unit: str) -> str:
    unit_shown, factor = DISPLAY_UNITS[unit]
    return f"{number(factor * float(value), 3)} {unit_shown}" if np.isfinite(value) else "no limit"


def answer_of_move(tuned: TunedMove) -> Answer:
    """Describe a move: duration, path error compared with rigid feedforward, and use of the motor limits."""
    rigid, last, has_samples = tuned.outcomes[0], tuned.outcomes[-1], bool(tuned.samples)
    fractions = np.array([np.abs(getattr(tuned, kind)).max(axis=0) for kind in KINDS]) / tuned.limits
    kind, i = np.unravel_index(int(np.argmax(fractions)), fractions.shape)
    peak = f"{list(KINDS)[kind]} of motor {tuned.joints[i]} reaches {percent(fractions[kind, i], 3)} of its limit"
    sentence = f"Yes. Closest to a limit: {peak}." if fractions.any() else "No limit is given."
    accuracy = (
        f"{tuned.duration:.4g} s: largest path error of {tuned.frame} {number(1e3 * last.largest, 3)} mm on the "
        f"{tuned.judge} (rigid feedforward: {number(1e3 * rigid.largest, 3)} mm); residual vibration "
        f"{number(rigid.residual / max(last.residual, 1e-12), 3)} times smaller."
    )
    sample_sentence = (
        f"{tuned.samples} posterior samples: largest error by elasticity {number(1e3 * float(last.high.max()), 3)} mm "
        f"(95 %), torques up to {100 * (tuned.max_torque / tuned.limits[3]).max():.0f} % of their limits."
        + (
            f" Errors of lengths and zeros within their tolerances move the path by up to "
            f"{number(1e3 * tuned.geometric_error_m, 3)} mm (95 %)."
            if tuned.geometric_error_m > 1e-6
            else ""
        )
        if last.high is not None and has_samples
        else ""
    )
    advice = f"{tuned.advice}." if tuned.advice else "Load tune.csv, or a file of the folder tune, into the drives."
    errors = [(o.name, *(number(1e3 * v, 3) for v in (o.largest, o.rms, o.static, o.residual))) for o in tuned.outcomes]
    limits = []
    for joint, unit, motor in zip(tuned.joints, tuned.units, range(len(tuned.joints)), strict=True):
        cells = [f"{joint} ({unit})"]
        for name, limit in zip(KINDS, tuned.limits[:, motor], strict=True):
            value = number(float(np.abs(getattr(tuned, name)[:, motor]).max()), 3)
            cells.append(f"{value} of {number(float(limit), 3)}" if np.isfinite(limit) else value)
        limits.append((*cells, *[number(float(tuned.max_torque[motor]), 4)] * has_samples))
    return Answer(
        f"Move of {tuned.name}",
        (
            ("How exactly does the tool follow?", tuple(filter(None, (accuracy, sample_sentence)))),
            ("Do the motors keep their limits?", (sentence,)),
            ("What next?", (capitalise(advice),)),
        ),
        (
            Display("Error of the tool in mm", ("command", "largest", "rms", "static", "vibration"), errors),
            Display("Limits of the motors", ("motor", *KINDS, *["torque of samples"] * has_samples), limits),
        ),
        (
            f"Simulated with position loops of {tuned.bandwidth_hz:.3g} Hz. Grey: the move; {1e3 * tuned.margin_s:.0f} "
            "ms before and after it the motors load and unload the springs. Link side, SI: largest value and limit of "
            "the robot model.",
        ),
    )


def answer_of_loops(loops: Loops) -> Answer:
    """Describe the present and the designed controller, and the limits of the designed gains."""
    new_loops, old_loops = loops.designed, loops.today
    worst = int(np.argmax(new_loops.peak_db))
    lines = [f"{new_loops.name}: {_loop_sentence(new_loops)}."]
    lines.append(f"Its gain is limited in posture {new_loops.postures[worst]}: {new_loops.limited_by[worst]}.")
    if loops.count:
        rate = 100 * float(np.mean(new_loops.drawn_peaks_db <= LIMIT_DB))
        lines.append(f"{rate:.3g} % of {loops.count} posterior samples stay below {LIMIT_DB:g} dB in all postures.")
    present = f"{old_loops.name}: {_loop_sentence(old_loops)}." if old_loops else "The study has no controller."
    peaks = [
        (loop.name, posture, number(peak, 3), f"{number(low, 3)} to {number(high, 3)}" if loops.count else "–", cause)
        for loop in loops.states
        for posture, peak, low, high, cause in zip(
            loop.postures, *(part.tolist() for part in (loop.peak_db, loop.peak_low, loop.peak_high)), loop.limited_by,
            strict=True,
        )
    ]  # fmt: skip
    new, notch_axes = loops.gains, np.array(loops.gains.axes, int)
    columns = new.position_gain, new.velocity_gain, 1 / new.position_gain, new.low_pass_hz
    gains = [
        (
            joint, *(number(float(column[i]), 4) for column in columns),
            ", ".join(number(freq_hz, 3) for freq_hz in new.notches[notch_axes == i, 0].tolist()),
            number(float(new_loops.bandwidth_hz[:, i].min()), 3),
        )
        for i, joint in enumerate(loops.joints)
    ]  # fmt: skip
    return Answer(
        f"Joint loops of {loops.name}",
        (
            ("How fast may the loops be?", tuple(lines)),
            ("How good is the present controller?", (present,)),
            ("What next?", ("Simulate the gains first: add the section of loops.yml to a study and run it.",)),
        ),
        (
            Display(
                "Sensitivity", ("controller", "posture", "peak in dB", "95 % of samples", "limited by"),
                peaks,
            ),
            Display("Gains", ("axis", "K_p 1/s", "K_v", "T_i s", "low pass Hz", "notches Hz", "bandwidth Hz"), gains),
        ),
        (
            f"Samples: {loops.count} posterior samples. Sensitivity: largest singular value, with the torques of the "
            "axes scaled by their inertias. Below: the section of a study, link side, SI.",
        ),
    )  # fmt: skip


def _loop_sentence(state: LoopState) -> str:
    if unstable := [name for name, peak in zip(state.postures, state.peak_db, strict=True) if not np.isfinite(peak)]:
        return f"unstable in posture {', '.join(unstable)}"
    lowest = state.bandwidth_hz.min(axis=0)
    bandwidths = ", ".join(f"{axis} {number(float(f), 3)}" for axis, f in zip(state.axes, lowest, strict=True))
    return f"bandwidth in Hz {bandwidths}; sensitivity peak {number(float(state.peak_db.max()), 3)} dB"
