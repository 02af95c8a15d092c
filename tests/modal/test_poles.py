"""Poles over model orders are those of the structure."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies
from modal.structures import BENCH, FREQ_HZ, NATURAL, ZETA, modal_response
from plants.marks import SEEDS
from plants.two_mass import circular

from elastid.experiment.simulated.plant import true_modes, true_response
from elastid.modal.estimate import estimate_modes, modal_data
from elastid.modal.model import ModalFit, tall_qr
from elastid.modal.modes import mac
from elastid.modal.pole_selection import residual_peaks
from elastid.modal.poles import HIGHEST, poles_over_orders, stabilisation
from elastid.response import Covariance, Response


def test_an_exact_response_gives_its_modes() -> None:
    """Three masses: frequencies, dampings and shapes to rounding."""
    natural, damping, shapes = true_modes()
    freq_hz = np.arange(20, 800) / 8
    response = Response(freq_hz, true_response(freq_hz), ("a", "b"), ("1", "2", "3"), "acceleration", BENCH)
    modes = estimate_modes(response)
    np.testing.assert_allclose(modes.freq_hz, natural / (2 * np.pi), rtol=1e-9)
    np.testing.assert_allclose(modes.zeta, damping, rtol=1e-8)
    np.testing.assert_allclose(np.diag(mac(modes.shapes, shapes)), 1, atol=1e-12)
    np.testing.assert_allclose(modes.collinearity, 1, atol=1e-12)
    np.testing.assert_allclose(modes.synthesis, response.G, atol=1e-9 * np.abs(response.G).max())
    largest = np.take_along_axis(shapes, np.abs(shapes).argmax(axis=0)[None], axis=0)
    np.testing.assert_allclose(modes.shapes.real, shapes / largest, atol=1e-8)


def test_pole_is_stable_within_hundredth_of_previous_order() -> None:
    """Of its frequency, and its damping within a twentieth."""
    before = 40.0 * np.array([-0.01 + 1j, -0.02 + 2j])
    same, moved, damped = 40.0 * np.array([-0.01004 + 1.004j, -0.02 + 2.05j, -0.022 + 2j])
    diagram = stabilisation(((4, before), (6, np.array([same, moved, damped]))))
    np.testing.assert_array_equal(diagram.order, [4, 4, 6, 6, 6])
    np.testing.assert_array_equal(diagram.stable, [False, False, True, False, False])


def test_what_a_model_leaves_has_candidates_at_its_peaks() -> None:
    """On the lines of all modes that it lacks, at several dampings."""
    data = modal_data(modal_response(FREQ_HZ, NATURAL, ZETA, np.ones((1, 5))), np.ones((len(FREQ_HZ), 1, 1)))
    found = residual_peaks(ModalFit(data, np.empty(0, complex))) * data.basis.scale / (2 * np.pi)
    assert set(NATURAL) <= set(found.imag.round(9))
    assert np.all(found.real < 0)


@settings(deadline=None, max_examples=30)
@given(strategies.integers(0, 2**32 - 1), *(strategies.integers(1, 3) for _ in range(3)))
def test_matrix_fraction_has_its_poles_only(seed: int, n_u: int, n_y: int, half: int) -> None:
    """Residues of rank 1 along z and a constant matrix are a fraction of order 2 n / n_u, for any weights."""
    rng, n = np.random.default_rng(seed), half * n_u
    freq_hz = np.cumsum(rng.uniform(0.5, 1.5, 150))
    size = 2 * np.pi * freq_hz[-1] * (np.linspace(0.1, 0.9, n) + rng.uniform(-0.03, 0.03, n))
    poles = size * (1j - rng.uniform(0.01, 0.1, n))
    step_s = HIGHEST / (2 * freq_hz[-1])
    z, roots = np.exp(-2j * np.pi * freq_hz * step_s)[:, None], np.exp(-step_s * poles)
    left = np.exp(2j * np.pi * rng.random((n_y, n)))
    right = np.tile(np.eye(n_u), half) + 0.1 * rng.normal(size=(n_u, n, 2)) @ (1, 1j)
    columns, residues = 1 / (z - roots), np.einsum("ir,jr->rij", left, right)
    mirrored = np.tensordot(1 / (z - roots.conj()), residues.conj(), 1)
    G = np.tensordot(columns, residues, 1) + mirrored + rng.normal(size=(n_y, n_u))
    orders = dict(poles_over_orders(freq_hz, G, rng.uniform(0.5, 2, 150), 2 * half + 2))
    assert list(orders) == list(range(2, 2 * half + 3))
    found = orders[2 * half]
    np.testing.assert_allclose(found[np.argsort(found.imag)], poles, rtol=1e-6)
    assert np.abs(orders[2 * half + 2][:, None] / poles - 1).min(axis=0).max() < 1e-6


def test_a_double_root_is_two_modes() -> None:
    """Two shapes at 40 Hz, two inputs: both, whose span is that of the true ones."""
    shapes = np.array([[1.0, 0.2, 0.5], [0.3, -1.0, 0.4], [0.6, 0.5, -0.9], [-0.2, 0.8, 0.3]])
    response = modal_response(FREQ_HZ, np.array([40.0, 40.0, 70.0]), np.array([0.01, 0.01, 0.02]), shapes, 2, 0.002)
    modes = estimate_modes(response)
    np.testing.assert_allclose(modes.freq_hz, [40, 40, 70], rtol=1e-4)
    plane, _ = np.linalg.qr(modes.shapes[:, :2])
    outside = shapes[:, :2] - plane @ (plane.conj().T @ shapes[:, :2])
    assert np.abs(outside).max() < 0.01


def test_noise_alone_has_no_mode() -> None:
    """Eight records, white and rising with frequency, one to four outputs, stated and not."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        shape = (len(FREQ_HZ), 1 + seed % 4, 1)
        std = (FREQ_HZ / 10 if seed % 2 else np.ones(len(FREQ_HZ)))[:, None, None] * np.ones(shape)
        G = std * circular(rng, shape)
        noise = Covariance(std**2, np.inf) if seed < 4 else None
        outputs = tuple(f"y{i}" for i in range(shape[1]))
        assert estimate_modes(Response(FREQ_HZ, G, ("u",), outputs, "velocity", BENCH, noise)).n_modes == 0


def test_six_by_six_and_chosen_poles() -> None:
    """Poles that are named are taken: two of five, of 6 x 6; the others are in the residuals of a band."""
    shapes = np.random.default_rng(2).normal(size=(6, 5))
    response = modal_response(FREQ_HZ, NATURAL, ZETA, shapes, 6, 0.01)
    assert estimate_modes(response).n_modes == 5
    modes = estimate_modes(response, band_hz=(20, 50), poles_hz=(25.2, 41))
    np.testing.assert_allclose(modes.freq_hz, [25, 41], rtol=1e-3)
    np.testing.assert_allclose(modes.zeta, ZETA[1:3], rtol=0.02)


def test_a_chosen_frequency_without_a_pole_is_named() -> None:
    """Between two modes there is none: the pole that wanders to a mode is not that at 55 Hz; two may name one mode."""
    shapes = np.random.default_rng(2).normal(size=(3, 5))
    response = modal_response(FREQ_HZ, NATURAL, ZETA, shapes, 1, 0.01)
    modes = estimate_modes(response, poles_hz=(55.0,))
    assert modes.n_modes == 0
    assert [note.code for note in modes.notes] == ["modal/poles"]
    both = estimate_modes(response, band_hz=(20, 33), poles_hz=(25.1, 25.2))
    np.testing.assert_allclose(both.freq_hz, [25], rtol=1e-3)


@pytest.mark.oracle("sdypy.EMA")
@pytest.mark.filterwarnings("ignore:.*outside the frequency range")  # its own upper limit, which it cuts off
def test_poles_and_shapes_agree_with_sdypy_ema() -> None:
    """Four modes seen at five places under one force, noise of 0.05 %: frequencies to 0.02 %, dampings to 5 %.

    Its estimator minimises an equation error, in which noise raises dampings by some per cent.
    """
    from sdypy import EMA

    freq_hz = np.arange(1, 800) / 8
    natural, zeta = np.array([18.0, 34.0, 52.0, 77.0]), np.array([0.012, 0.02, 0.01, 0.015])
    shapes = np.random.default_rng(3).normal(size=(5, 4))
    response = modal_response(freq_hz, natural, zeta, shapes, noise=0.0005)
    modes = estimate_modes(response)
    peer = EMA.Model(response.G[:, :, 0].T, freq_hz, lower=5, upper=98, pol_order_high=40)
    peer.get_poles(show_progress=False)
    peer.select_closest_poles(list(natural), f_window=5)
    _, constants = peer.get_constants(whose_poles="own")
    np.testing.assert_allclose(modes.freq_hz, peer.nat_freq, rtol=2e-4)
    np.testing.assert_allclose(modes.zeta, peer.nat_xi, rtol=0.05)
    np.testing.assert_allclose(np.diag(mac(modes.shapes, constants)), 1, atol=1e-3)
    # The truth is nearer to these modes than to the equation error's.
    assert np.all(np.abs(modes.freq_hz - natural) < 4 * modes.freq_std)
    assert np.all(np.abs(modes.zeta - zeta) < 4 * modes.zeta_std)


@pytest.mark.parametrize("seed", SEEDS)
def test_resonances_between_lines_are_single_modes(seed: int) -> None:
    """Three references, each with natural frequencies of its own; the widths are a thirtieth to a third of a line."""
    freq_hz, natural = np.arange(1.0, 201.0), np.array([31.5, 87.45, 152.4])
    zeta, shapes = np.array([5.5, 3.7, 2.0]) * 1e-4, np.random.default_rng(5).uniform(0.4, 1.0, (3, 3))
    rng = np.random.default_rng(seed)
    each = [
        modal_response(freq_hz, natural * (1 + 4e-5 * rng.standard_normal(3)), zeta, shapes[[r, 0]]).G[:, 1:]
        for r in range(3)
    ]
    G = np.concatenate(each, axis=2)
    G = G * (1 + 0.02 * circular(rng, G.shape))
    G[114:117, 0, 2] += 2 * np.median(np.abs(G)) * np.array([0.6 + 0.5j, 0.4 - 0.9j, 0.3 - 0.5j])
    response = Response(freq_hz, G, ("a", "b", "c"), ("y",), "acceleration", BENCH)
    np.testing.assert_allclose(estimate_modes(response).freq_hz, natural, atol=0.03)


def test_opposite_phase_response_has_conjugate_modes() -> None:
    """Frequencies and dampings are those of the response itself; the note has the code modal/phase."""
    response = modal_response(FREQ_HZ[:300], NATURAL[:2], ZETA[:2], np.ones((2, 2)), noise=0.01)
    modes, inverted = (estimate_modes(each) for each in (response, replace(response, G=response.G.conj())))
    assert [note.code for note in inverted.notes] == ["modal/phase"]
    assert modes.notes == ()
    np.testing.assert_allclose(inverted.freq_hz, modes.freq_hz, rtol=1e-6)
    np.testing.assert_allclose(inverted.zeta, modes.zeta, rtol=1e-4)


@pytest.mark.parametrize("seed", range(20))
def test_a_tall_matrix_has_orthonormal_factors(seed: int) -> None:
    """Three pairs of columns that differ by 1e-11 to 1e-5: Q^T Q = I and A = Q R to rounding, R triangular."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((500, 12))
    A[:, :3] = A[:, 3:6] + 10 ** rng.uniform(-11, -5, 3) * A[:, :3]
    A /= np.linalg.norm(A, axis=0)
    Q, R = tall_qr(A)
    np.testing.assert_allclose(Q.T @ Q, np.eye(12), atol=1e-12)
    np.testing.assert_allclose(Q @ R, A, atol=1e-12)
    np.testing.assert_array_equal(np.tril(R, -1), 0)
