"""Maps of a study from the command line."""

import csv
from pathlib import Path

import numpy as np
import pytest
from plants.arm_study import command

from elastid.store.results import read_fit, read_map


@pytest.mark.slow
def test_fitted_study_is_mapped_at_random_path_and_poses(fitted_arm: Path) -> None:
    """The same seed gives the same bytes; a path's postures are those of its rows; the result answers itself."""
    run = fitted_arm.parent / "run"
    assert command("map", fitted_arm, "--random", "30") == 0
    first = (run / "map.csv").read_bytes()
    assert command("map", fitted_arm, "--random", "30", "--jobs", "1") == 0
    assert (run / "map.csv").read_bytes() == first
    assert {"map.h5", "map.csv", "map.html", "map.png"} <= {path.name for path in run.iterdir()}
    path = fitted_arm.parent / "path.csv"
    path.write_text("1 deg,2 deg\n20,40\n-10,10\n")
    assert command("map", fitted_arm, "--path", path, "--normal", "0", "0", "1", "--load", "0", "0", "-10") == 0
    workspace = read_map(run / "map.h5")
    np.testing.assert_allclose(workspace.angles, np.radians([[20, 40], [-10, 10]]))
    stiff = read_fit(run / "fit.h5").at("down", axes="world").stiffness()
    np.testing.assert_allclose(workspace["compliance_z"].value[0], stiff.compliance[2, 2], rtol=1e-6)
    path.write_text("x,y,z\n1.0,0,-0.3\n5,0,0\n")
    assert command("map", fitted_arm, "--path", path) == 0
    with (run / "map.csv").open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    # The frame hangs below where it would be without gravity.
    assert float(row["x"]) == pytest.approx(1.0, abs=5e-3)
    assert float(row["z"]) == pytest.approx(-0.3, abs=2e-2)
    assert float(row["z"]) < -0.3
