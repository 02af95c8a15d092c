"""Files of drawn robots: a table, robot files that load, MJCF, and a reason where there is none."""

import csv
from pathlib import Path

import numpy as np
import pytest
from plants.arm import result
from plants.fitted_models import fitted_model

from elastid.study import load_robot
from elastid.targets.draws import write_draws
from elastid.use.draws import draw_robots


def test_table_and_robot_files_hold_the_same_numbers(tmp_path: Path) -> None:
    """Each row is the robot of its number, read back in full; MJCF beside it has its stiffnesses."""
    draws = draw_robots(result(), 12, seed=3)
    warnings = []
    paths = write_draws(tmp_path, draws, "arm", warnings.append)
    assert [path.name for path in paths] == ["samples.csv", "robots", "mujoco"]
    assert not warnings
    with (tmp_path / "samples.csv").open() as file:
        head, *rows = list(csv.reader(file))
    assert head == ["sample", *draws.names]
    assert [row[0] for row in rows] == [f"{i:02d}" for i in range(1, 13)]
    for row, robot in zip(rows, draws.robots, strict=True):
        loaded = load_robot(tmp_path / "robots" / f"robot_{row[0]}.yml")
        numbers = loaded.parameters()
        for name, cell in zip(head[1:], row[1:], strict=True):
            if name in numbers:
                assert numbers[name][0] == pytest.approx(float(cell), rel=1e-14)
        assert loaded.parameters() == robot.parameters()
        assert (tmp_path / "mujoco" / f"robot_{row[0]}.xml").read_text().startswith("<mujoco")


@pytest.mark.oracle("mujoco")
@pytest.mark.parametrize("name", ["arm", "linkage_arm minimal"])
def test_an_engine_loads_each_draw_with_its_own_stiffness(name: str, tmp_path: Path) -> None:
    """MuJoCo: joints' stiffness differs from draw to draw as the table says."""
    import mujoco

    draws = draw_robots(fitted_model(name).result, 3, seed=4)
    write_draws(tmp_path, draws, "arm", warn=print)
    models = [mujoco.MjModel.from_xml_path(str(path)) for path in sorted((tmp_path / "mujoco").iterdir())]
    stiff = np.array([np.unique(np.round(model.jnt_stiffness[model.jnt_stiffness > 0], 6)) for model in models])
    assert len(models) == 3
    assert len(np.unique(stiff[:, 0])) == 3
