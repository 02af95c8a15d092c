"""Friction at the motors is found in the multisine's own records."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plants.dry_friction import COULOMB, measured, measured_bristles
from plants.marks import slow
from plants.units import factor, record_in_other_units

from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, period_spectra
from elastid.nonlinear import identify_friction
from elastid.nonlinear.compensate_friction import compensate_friction
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import friction_means, spectrum
from elastid.nonlinear.identify_friction import identify_motor_friction
from elastid.record import Record

AUTO = EstimatorSpec(friction="auto")


@pytest.fixture(scope="module")
def found() -> CompensatedFriction:
    return identify_motor_friction(*measured_with(AUTO))


def measured_with(spec: EstimatorSpec) -> tuple[tuple[tuple[Record, ...], ...], EstimatorSpec, np.ndarray]:
    configurations, lines = measured()
    return configurations, spec, lines


@pytest.mark.parametrize("friction", ["coulomb", "curve", "auto"])
def test_the_level_of_coulomb_friction_is_found_without_a_model(friction: str, found: CompensatedFriction) -> None:
    """Within 2 % of the truth at both motors, whatever shapes are allowed; torques in time have no delay."""
    spec = replace(AUTO, friction=friction)
    result = found if friction == "auto" else identify_motor_friction(*measured_with(spec))
    (delay_s,) = {shape.delay_s for shape in result.shapes}
    assert delay_s * measured()[0][0][0].rate_hz == pytest.approx(0, abs=0.1)
    assert "nonlinear/torque-delay" not in {note.code for note in result.notes}
    coefficients = [result.coulomb_friction(place)[0] for place in result.places]
    np.testing.assert_allclose(coefficients, COULOMB, rtol=0.02)
    assert np.all(result.after < 0.25 * result.before)


@pytest.mark.parametrize("samples", [slow(-2), 0.3, 3])
def test_shifted_torques_have_friction_of_motion(samples: float) -> None:
    """Torques logged some samples off: the delay to a tenth of a sample, with its note; coefficients within 2 %."""
    configurations, lines = measured()
    n = len(configurations[0][0].u)
    turn = np.exp(-2j * np.pi * np.fft.rfftfreq(n) * samples)[:, None]
    late = [[np.fft.irfft(turn * np.fft.rfft(r.u, axis=0), n, axis=0) for r in records] for records in configurations]
    moved = [[replace(r, u=u) for r, u in zip(*pair, strict=True)] for pair in zip(configurations, late, strict=True)]
    result = identify_motor_friction(moved, AUTO, lines)
    (delay_s,) = {shape.delay_s for shape in result.shapes}
    assert delay_s * configurations[0][0].rate_hz == pytest.approx(samples, abs=0.1)
    assert "nonlinear/torque-delay" in {note.code for note in result.notes}
    np.testing.assert_allclose([result.coulomb_friction(place)[0] for place in result.places], COULOMB, rtol=0.02)


@pytest.mark.parametrize("signal", ["u", "y"])
def test_copied_experiments_and_equal_motors_are_refused(signal: str) -> None:
    """Torques that do not separate the inputs, or angles that do not separate the motors, leave nothing to invert."""
    configurations, lines = measured()
    records = configurations[0]
    if signal == "u":
        of_realisation = {record.realisation: record for record in reversed(records)}
        spoilt = [replace(of_realisation[each.realisation], experiment=each.experiment) for each in records]
        spoilt = [replace(each, u=each.u[:, [0, 0]]) for each in spoilt]
    else:
        spoilt = [replace(each, y=each.y[:, [0, 0]]) for each in records]
    result = identify_motor_friction([tuple(spoilt)], AUTO, lines)
    assert result.shapes == ()
    (note,) = result.notes
    assert note.code == "nonlinear/friction-not-compensated"


def test_friction_torque_has_no_zero_order_hold(found: CompensatedFriction) -> None:
    """At the lines the net torque is H U - sum f Phi, H being the hold of the torque alone."""
    configurations, lines = measured()
    record = configurations[0][0]
    raw, net = (
        period_spectra(RecordSpectra(each), lines, "acceleration").U.mean(axis=0)
        for each in (record, compensate_friction(record, found))
    )
    for i, place in enumerate(record.inputs):
        means = friction_means(record, found.motion(record, place), found.compensated_basis(place))
        torque = spectrum(np.fft.rfft(means), len(means) // 4)
        at_lines = torque[lines * record.n_periods] * 2 / (record.n_periods * record.period_samples)
        np.testing.assert_allclose((raw - net)[:, i], at_lines, atol=1e-12)


def test_one_realisation_shows_friction_where_lines_are_not_excited() -> None:
    """On the odd-random grid, within 2 %; where all lines are excited a sentence asks for another realisation."""
    configurations, lines = measured()
    single = [[record for record in records if record.realisation == 0] for records in configurations]
    result = identify_motor_friction(single, AUTO, lines)
    np.testing.assert_allclose([result.coulomb_friction(place)[0] for place in result.places], COULOMB, rtol=0.02)
    every = identify_motor_friction(single, AUTO, lines[:1])
    assert every.shapes == ()
    assert every.notes[0].code == "nonlinear/friction-not-compensated"
    assert re.findall(r"\d+", every.notes[0].text) == ["2"]  # experiments


def test_coarse_encoder_hides_velocity_sign() -> None:
    """Noise and speed are named."""
    configurations, lines = measured()
    count = 2 * np.pi / 1000 / 6
    coarse = [[replace(r, y=np.round(r.y / count) * count) for r in records] for records in configurations]
    result = identify_motor_friction(coarse, AUTO, lines)
    assert result.shapes == ()
    assert "finer resolution" in result.notes[0].text


@pytest.mark.slow
@pytest.mark.parametrize("coulomb", [COULOMB, (0.0, 0.0)])
def test_shapes_may_be_chosen_in_the_first_configuration_alone(
    coulomb: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where records are many; coefficients are those of all configurations, and none where there is no friction."""
    configurations, lines = measured(coulomb)
    monkeypatch.setattr(identify_friction, "_CHOICE_RECORDS", 1)
    result = identify_motor_friction(configurations, AUTO, lines)
    assert result.configurations == ("a", "b")
    assert bool(result.shapes) == bool(coulomb[0])
    np.testing.assert_allclose([result.coulomb_friction(place)[0] for place in result.places], coulomb, rtol=0.02)


@pytest.mark.slow
def test_coulomb_torques_varying_by_posture_widen_interval() -> None:
    """Half as much friction in the second: the coefficient is between both, and each is within its 95 % interval."""
    (one, _), lines = measured()
    (_, other), _ = measured((COULOMB[0] / 2, COULOMB[1]))
    result = identify_motor_friction((one, other), AUTO, lines)
    (note,) = [note for note in result.notes if note.code == "nonlinear/friction-varies"]
    assert note.text.startswith("motor 1")
    coefficient, std = result.coulomb_friction("motor 1")
    assert COULOMB[0] / 2 < coefficient < COULOMB[0]
    assert std == pytest.approx(COULOMB[0] / 2 / 2**0.5, rel=0.1)  # of two draws that are so far apart
    assert result.coulomb_friction("motor 2")[1] < 0.02 * COULOMB[1]


@pytest.mark.slow
@pytest.mark.parametrize("law", ["coulomb", slow("lugre"), "maxwell slip"])
def test_friction_is_equal_in_other_units_and_order(law: str) -> None:
    """The coefficient of sliding within 5 %, with its std; the distortion falls to less than a fifth; bristles bend."""
    configurations, lines = measured() if law == "coulomb" else measured_bristles(law)
    here = identify_motor_friction(configurations, AUTO, lines)
    turned = [[record_in_other_units(replace(r, u=r.u[:, ::-1], y=r.y[:, ::-1])) for r in c] for c in configurations]
    there = identify_motor_friction(turned, AUTO, lines)
    assert {shape.kind == "sign" for shape in (*here.shapes, *there.shapes)} == {law == "coulomb"}
    coefficients = np.array([[found.coulomb_friction(place) for place in here.places] for found in (here, there)])
    np.testing.assert_allclose(coefficients[0, :, 0], COULOMB, rtol=0.05)
    np.testing.assert_allclose(coefficients[1, ::-1], coefficients[0] * factor("N*m"), rtol=1e-9)
    assert np.all(here.after < 0.2 * here.before)
    np.testing.assert_allclose(there.after[:, ::-1], here.after * factor("N*m"), rtol=1e-9)
