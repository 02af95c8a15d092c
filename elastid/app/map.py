"""map: the fitted robot along a path, over a grid or at random postures -> map.h5, map.csv, map.html, map.png."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from elastid.app.export import gears_of
from elastid.app.run import Run
from elastid.app.use_fit import Used, use_fit
from elastid.base.arrays import FloatArray
from elastid.base.display import number
from elastid.base.errors import StudyError
from elastid.fit.posture import Family
from elastid.fit.result import Result
from elastid.nonlinear.gear_result import with_gears
from elastid.report.answer import Answer
from elastid.report.figures.use import workspace_figure
from elastid.report.page.page_of_use import write_page_of_map
from elastid.store.results import write_map, write_map_table
from elastid.use.compliance import Cut
from elastid.use.map import WorkspaceMap, family_of_map, map_workspace
from elastid.use.postures import grid_postures, random_postures, read_path


@dataclass(frozen=True)
class Postures:
    """Postures of a map: a path, a grid of so many points along the longest side, or so many random postures."""

    path: Path | None = None
    grid: int | None = None
    random: int | None = None

    def __post_init__(self) -> None:
        if sum(each is not None for each in (self.path, self.grid, self.random)) > 1:
            raise StudyError("options/invalid", "--path, --grid and --random exclude one another; give one of them")

    def angles(self, run: Run, family: Family) -> FloatArray:
        """Angles (Q, n_u) of the driven joints; says what cannot be reached."""
        if self.path is not None:
            angles, remarks = read_path(self.path, family.robot, family.frame)
            for words in remarks:
                run.console.warn(f"map: {words}")
            return angles
        seed = run.study.seed or 0
        if self.grid is not None:
            return grid_postures(family.robot, family.frame, self.grid, seed)
        return random_postures(family.robot, self.random or 1000, seed)


def map_study(
    run: Run, frame: str | None, postures: Postures, cut: Cut, band_hz: Sequence[float] | None = None
) -> None:
    """map.h5, map.csv, map.html and map.png of the study's fit; StudyError without a current one."""

    def work(fit: Result) -> Used:
        family = family_of_map(with_gears(fit, gears_of(run)), frame)
        angles = postures.angles(run, family)
        lines = None if not band_hz else np.geomspace(band_hz[0], band_hz[1], 300)
        is_path = postures.path is not None
        workspace = map_workspace(family, angles, cut, lines_hz=lines, name=run.study.name, is_path=is_path)
        files = {
            "map.h5": lambda path: write_map(path, workspace, run.stamps["fit"]),
            "map.csv": lambda path: write_map_table(path, workspace),
        }
        figure, page = partial(workspace_figure, workspace), partial(write_page_of_map, workspace)
        answer = Answer(f"Map of {workspace.name}", (("Where is it soft?", sentences(workspace)),))
        return Used(answer, files, figure, page)

    use_fit(run, "map", work)


def sentences(workspace: WorkspaceMap) -> tuple[str, ...]:
    """Sentences on where the robot is soft, what limits it, and how sure that is."""
    compliance = workspace["softest_compliance"]
    order = workspace.softest
    soft, stiff = int(order[0]), int(order[-1])
    ends = " to ".join(number(1e6 * float(compliance.value[i]), 3) for i in (stiff, soft))
    count = f"{len(workspace)} postures" + (f", {len(workspace.refused)} without rest" if workspace.refused else "")
    spring = workspace.limiting_springs[soft]
    part = float(workspace.share[soft].max(initial=0.0))
    return (
        f"{count}: softest direction {ends} um/N (std {100 * float(compliance.relative_std.max()):.2g} % or less)",
        f"softest at posture {workspace.asked[soft] + 1}: {spring} gives {100 * part:.0f} % of it, and twice as stiff "
        f"it would take {50 * part:.0f} % off",
    )
