"""The C code of a filter, compiled without dependencies, does what the filter does."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from plants.hostile_names import HOSTILE

from elastid.friction_study.extended_kalman_filter import FilterNoise, KalmanFilter
from elastid.targets.friction import Observer, write_observers
from tests.plants.warm_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, rich, simulate

NOISE = FilterNoise(angle=COUNT / np.sqrt(12), torque=TORQUE_STD, drift={"Fc": 6e-3, "f": 25e-3, "offset": 1e-3})


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
def test_c_compiles_whatever_the_joints_are_called(tmp_path: Path) -> None:
    """CasADi refuses two underscores in a row in the name of a function, C much else."""
    names = (*HOSTILE[:: 1 + len(HOSTILE) // 10], "axis - 1", "axis 1", "x*/ #error pwn")
    source, _ = write_observers(tmp_path, dict.fromkeys(names, Observer(FOLLOWED, NOISE, RATE_HZ)))
    command = ["cc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", source]
    compiled = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (compiled.returncode, compiled.stderr) == (0, "")


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")
def test_c_follows_friction_as_the_filter_does(tmp_path: Path) -> None:
    """States and covariance of a second, to rounding."""
    source, header = write_observers(tmp_path, {"2": Observer(FOLLOWED, NOISE, RATE_HZ)})
    library = tmp_path / "observer.so"
    flags = ["-std=c99", "-O2", "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, source, "-o", library, "-lm"], check=True)
    assert "x[5] Fc, x[6] f, x[7] offset" in header.read_text()
    assert "Fc 0.5554 to 1.8, f 0.003003 to 0.02132, offset -0.98 to 0.98" in header.read_text()
    samples = simulate(rich(1.0), seed=2).samples
    c, n, m = ctypes.CDLL(str(library)), len(FOLLOWED.states), len(FOLLOWED.held)
    doubles = ctypes.c_double * n, ctypes.c_double * (n * (n + m))
    x, P = doubles[0](), doubles[1]()
    c.joint_2_start(x, P, ctypes.c_double(samples.angle[0]), ctypes.c_double(0.0))
    for u, g, y in zip(samples.torque, samples.load, samples.angle, strict=True):
        c.joint_2_follow(x, P, *(ctypes.c_double(value) for value in (u, g, y)), None, None)
    track = KalmanFilter(FOLLOWED, RATE_HZ).run([samples], NOISE)
    np.testing.assert_allclose(np.array(x), track.x[-1], rtol=1e-9, atol=1e-12)
    std = np.sqrt(np.diag(np.array(P).reshape(n, n + m, order="F")))
    np.testing.assert_allclose(std, track.std[-1], rtol=1e-6, atol=1e-9)
