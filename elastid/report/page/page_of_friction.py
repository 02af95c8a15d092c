"""Page of a friction study: answers, table of parameters, and figures of each joint."""

from collections.abc import Collection

from elastid.base.display import number
from elastid.friction_study.result import JointFriction
from elastid.report.figures.drawings import JOINT
from elastid.report.friction_content import NUMBER_HEADINGS, FrictionContent, number_cells, refusals
from elastid.report.page.page import EmbeddedFigure, render

# Names of parameters that all constant-velocity runs of a joint have in common.
COMMON_NUMBERS = {
    "inertia": "inertia",
    "slope": "slope of friction within a pass",
    "gravity.cos": "gravity, part of cos q",
    "gravity.sin": "gravity, part of sin q",
    "offset": "offset of the torque",
}


def html_of_friction(content: FrictionContent, figures: Collection[EmbeddedFigure]) -> str:
    """Render the page; every text from a study or a file is escaped."""
    result = content.result
    rows = [(row, number_cells(row)) for row in result.numbers]
    return render(
        "friction.html.j2", content, figures, result=result, headings=NUMBER_HEADINGS, rows=rows,
        shared=shared_numbers, section=JOINT, refusals=refusals(result),
    )  # fmt: skip


def shared_numbers(joint: JointFriction) -> tuple[tuple[str, str, str, str], ...]:
    """Return numbers that all runs of a joint share, without friction: name, value, std and unit."""
    if joint.constant_velocity is None:
        return ()
    torque = "N" if joint.slides else "N*m"
    units = {"inertia": "kg" if joint.slides else "kg*m^2", "slope": "N*s/m" if joint.slides else "N*m*s/rad"}
    rows = []
    for name, (value, std) in joint.constant_velocity.shared.items():
        kind = ".".join(name.split(".")[:2])  # gravity.cos.full is gravity.cos with the load full
        load = name[len(kind) + 1 :]
        if kind in COMMON_NUMBERS:
            text = COMMON_NUMBERS[kind] + (f" ({load})" if load else "")
            rows.append((text, number(value), number(std, 2), units.get(name, torque)))
    return tuple(rows)
