"""Kernels in C: numbers of NumPy at every processor level, on edges too, and no library that does not fit."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from plants.two_mass import circular

from elastid.base import fourier, kernels, matrices
from elastid.base.fourier import real_dft
from elastid.friction import stop_operator
from elastid.linear.response.kernel import Elimination

needs_kernels = pytest.mark.skipif(not kernels.is_compiled(), reason="the kernels in C are not built")
LEVELS = ("portable", "avx2", "avx512")
CACHES = (kernels._library, kernels._processor_level, kernels._kernel)


def forget() -> None:
    for cache in CACHES:
        cache.cache_clear()


@pytest.fixture
def _forgotten() -> Iterator[None]:
    """Nothing is remembered of another library or level."""
    forget()
    yield
    forget()


def results(level: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, np.ndarray]:
    """Kernels that compute each line as if it were alone, on 37 lines, and a bristle along a motion."""
    with monkeypatch.context() as patched:
        patched.setattr(kernels, "_processor_level", lambda: level)
        kernels._kernel.cache_clear()
        rng = np.random.default_rng(1)
        A, B = circular(rng, (37, 5, 4)), circular(rng, (37, 5, 5))
        root = rng.normal(size=(3, 6, 6))
        M, D, K = root @ root.transpose(0, 2, 1) + 3 * np.eye(6)
        sides = np.eye(6)[:, :2], np.eye(6)[:, 1:5]
        velocity = np.linspace(-1, 1, 37)[:, None] * np.linspace(-0.5, 1, 17)
        values = {
            "products": matrices.added_cross_products([A], [A]),
            "inverse": matrices.inverse(B),
            "singular values": matrices.singular_values(A),
            "transforms": real_dft(rng.normal(size=(3, 2 * 8 * 7 * 5 * 3 * 2, 5))),
            "responses": Elimination.of(np.ones((6, 6), bool)).products(M, D, K, np.linspace(0.1, 9.0, 37), *sides),
            "bristle": stop_operator.bristle(stop_operator.Path.of(velocity.ravel()), 0.2),
        }
    kernels._kernel.cache_clear()
    return values


@needs_kernels
def test_levels_of_the_processor_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bit where sums run over no lines and both levels multiply and add in one; to rounding without."""
    available = LEVELS[: LEVELS.index(kernels._processor_level()) + 1]
    own = results(available[-1], monkeypatch)
    for level in available[:-1]:
        for name, value in results(level, monkeypatch).items():
            np.testing.assert_allclose(value, own[name], rtol=0, atol=1e-13 * np.abs(own[name]).max(), err_msg=name)
            if level != "portable":
                assert value.tobytes() == own[name].tobytes(), (level, name)


@needs_kernels
@pytest.mark.parametrize("F", [0, 1, 8, 9])
def test_edges_are_those_of_numpy(F: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """No line, one, a full register, one more; no column; zeros; NaN stays in its line."""
    rng = np.random.default_rng(F)
    A, zero = circular(rng, (F, 3, 3)), np.zeros((F, 3, 3), complex)
    nothing = np.zeros((F, 3, 0), complex)
    hurt = A.copy()
    hurt[F // 2 : F // 2 + 1, 0, 1] = np.nan
    calls = [
        lambda: matrices.added_cross_products([nothing], [nothing]),
        lambda: matrices.added_cross_products([hurt], [A]),
        lambda: matrices.inverse(A + 3 * np.eye(3)),
        lambda: matrices.singular_values(zero),
        lambda: matrices.singular_values(A),
        lambda: matrices.singular_values(A[:, :2]),
        lambda: matrices.singular_values(A[:, :, :1]),
        lambda: matrices.added_products([A, A], [A, zero]),
        lambda: matrices.added_error_products([A], A[:, :, :2], [A[:, :2]]),
    ]
    for call in calls:
        in_c = call()
        with monkeypatch.context() as patched:
            patched.setattr(matrices, "is_compiled", lambda: False)
            np.testing.assert_allclose(in_c, call(), rtol=0, atol=1e-13)


@needs_kernels
@pytest.mark.parametrize("N", [2, 4, 26, 30, 45, 64, 34, 1000])
def test_transforms_are_those_of_numpy(N: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of channels of a view, at chosen lines up to the last; lengths of small factors and others."""
    x, lines = (
        np.random.default_rng(N).normal(size=(3, N, 7))[:, :, 1:6].astype("f4" if N == 64 else "f8"),
        np.array([0, N // 4, N // 2]),
    )
    in_c = real_dft(x, lines)
    monkeypatch.setattr(fourier, "is_wide", lambda: False)
    np.testing.assert_allclose(in_c, real_dft(x, lines), rtol=0, atol=1e-14 * N)


@pytest.mark.usefixtures("_forgotten")
def test_without_a_library_numpy_does_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """An installation of pure Python is whole: no warning; a call that is made all the same says what to do."""
    monkeypatch.setattr(kernels, "LIBRARY", tmp_path / "kernels.so")
    assert not kernels.is_compiled()
    np.testing.assert_allclose(matrices.inverse(2 * np.eye(3)[None] + 0j)[0], np.eye(3) / 2)
    assert not caplog.messages
    with pytest.raises(RuntimeError, match="install elastid again"):
        kernels.call("inverse")


@needs_kernels
@pytest.mark.usefixtures("_forgotten")
@pytest.mark.parametrize("fault", ["no library", "other sources"])
def test_library_of_other_version_is_refused_with_warning(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """A file that is none, and one that was built before its sources changed."""
    library = tmp_path / "kernels.so"
    shutil.copyfile(kernels.LIBRARY, library)
    if fault == "no library":
        library.write_bytes(b"no library")
    else:
        monkeypatch.setattr(kernels, "sources_hash", lambda: "another")
    monkeypatch.setattr(kernels, "LIBRARY", library)
    assert not kernels.is_compiled()
    assert not kernels.is_compiled()
    (message,) = caplog.messages
    assert message.startswith(f"{library} is not used, NumPy does its work: ")
    assert "install elastid again" in message
