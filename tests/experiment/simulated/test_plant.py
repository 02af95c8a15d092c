"""The predicted closed loop and the references that a plan is given."""

from dataclasses import replace

import numpy as np
from plants.limited_arm import EXCITATION, arm, experiment
from scipy.linalg import eigh

from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.plant import (
    DAMPING,
    EXCITED_STATES,
    MASSES,
    STIFFNESSES,
    closed_loop_of,
    shake,
    true_response,
)
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.robot import Limits
from elastid.robot.simplified import without_dry_friction


def test_the_closed_loop_response_is_what_the_simulation_does() -> None:
    """Without friction and gravity, the torque and all motions at all lines, to aliasing."""
    machine = arm(Limits()).with_parameters({"fm_1": 1e-6, "fm_2": 1e-6})
    machine = replace(without_dry_friction(machine), gravity=(0.0, 0.0, 0.0))
    spec = experiment(simulated=SimulatedSpec(substeps=4), transient_periods=6)
    plan = make_plan(replace(EXCITATION, torque_rms=1.0), spec, machine, 0)
    rig = SimulatedRig(machine, spec, plan, 0)
    loop = closed_loop_of(machine, spec.as_simulated().controller, 500.0)(plan.configurations[0], plan.freq_hz)
    rehearsal = rig.rehearse(rig.experiments[1])
    (last,) = np.nonzero((rehearsal.time_s > 5.999) & (rehearsal.time_s < 6.999))
    signals = ("torque", "position", "velocity", "acceleration")
    for signal, quantity in zip(rehearsal.signals, signals, strict=True):
        measured = np.fft.rfft(signal[last], axis=0)[plan.lines] / 250
        expected = np.einsum("foi,fi->fo", loop.stacked((quantity,)), plan.R[0, 0, 1])
        assert np.abs(measured - expected).max() < 0.01 * np.abs(expected).max()


def test_shaken_masses_move_as_their_equations_say() -> None:
    """G = -omega^2 C (K - omega^2 M + j omega D)^-1 B of forces of 5 N rms, D of the damping ratio of each mode."""
    M, stretch = np.diag(MASSES), np.eye(3) - np.eye(3, k=-1)
    K = stretch.T @ np.diag(STIFFNESSES) @ stretch
    squares, modes = eigh(K, M)
    D = M @ modes @ np.diag(2 * np.array(DAMPING) * np.sqrt(squares)) @ modes.T @ M
    lines = np.arange(6, 205)
    omega = 2 * np.pi * 0.5 * lines[:, None, None]
    G = -(omega**2) * np.linalg.solve(K - omega**2 * M + 1j * omega * D, np.eye(3)[:, EXCITED_STATES].astype(complex))
    np.testing.assert_allclose(true_response(0.5 * lines), G, rtol=1e-9)
    logs = np.array([log.reshape(4, 512, 5).mean(axis=0) for log in shake(256.0, 512, 4, 3)])
    np.testing.assert_allclose(logs[:, :, :2].std(axis=1), 5.0, rtol=0.01)
    spectra = np.moveaxis(np.fft.rfft(logs, axis=1)[:, lines], 0, 2)
    Y = spectra[:, 2:] @ np.linalg.inv(spectra[:, :2])
    assert np.abs(Y - G).max() < 0.1 * np.abs(G).max()
