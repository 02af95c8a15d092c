"""Results of an identification as values: truth, modes, and summary.json and validation.json, both of a fixed form."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elastid.app.dry_friction import contents, friction_summary, mixed_numbers
from elastid.app.json_values import SCHEMA, all_finite, balance_entries, finite, note_entries, run_entries
from elastid.base.note import Note, grouped
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.modification_index import ModificationIndex
from elastid.fit.result import FitResult
from elastid.fit.setup.parameter_choice import choose
from elastid.fit.solve.local_optimum import LocalOptimum
from elastid.linear.equilibrium import equilibrium
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.modes import modes, shapes_of_all
from elastid.linear.propagation import uncertain_modes
from elastid.linear.strain_energy import strain_energy
from elastid.model.elastic import ElasticModel
from elastid.model.stick_figure import stick_figure
from elastid.nonlinear.result import FrictionTakenOut
from elastid.report.modes.mode_drawing import mode_drawing
from elastid.report.modes.mode_row import ModeRow, load_name, spring_names
from elastid.report.parameter_rows import parameter_rows
from elastid.store import text_file
from elastid.study import Study
from elastid.validation.results import Agreement, Replay, Validation
from elastid.validation.twin_run import NO_TWIN, TwinFindings

CORRELATED = 0.9


def truth(study: Study, friction: FrictionTakenOut | None = None) -> dict[str, float] | None:
    """The simulated robot's numbers by name, in SI, as far as a fit can meet them; None where it is recorded.

    friction: what was taken out of the responses; viscous coefficients that contain dry friction have no truth.
    """
    simulated = study.experiment.simulated
    if simulated is None:
        return None
    robot, mixed = study.as_robot(), mixed_numbers(study, friction)
    named = (*robot.geometry, *(name for name in robot.gains if name in study.fit.parameters))
    numbers = {name: value for name, (value, _) in robot.parameters(named).items()} | {DELAY: 0.0}
    return {name: float(value) for name, value in (numbers | simulated.truth).items() if name not in mixed}


def modes_of(fitted: FittedRobot) -> tuple[ModeRow, ...]:
    """The modes of the fitted model with its motors free, configuration by configuration."""
    return tuple(_mode_row(fitted.model, model, fitted.result) for model in fitted.linear)


def _mode_row(elastic: ElasticModel, model: LinearModel, result: FitResult) -> ModeRow:
    """Frequencies and damping, who moves, where the energy is, and the robot's sticks."""
    configuration = model.configuration
    theta = result.theta_of(configuration.name)
    robot = elastic.robot_at(theta[:-1])
    found = modes(model, theta)
    sure = uncertain_modes(model, result.parameters, result.x, result.covariance)
    shapes, point = shapes_of_all(model, found.shapes), equilibrium(elastic, theta[:-1], configuration)
    energy = strain_energy(elastic, theta[:-1], point, shapes)
    names, n_l = spring_names(robot), len(robot.joints)
    return ModeRow(
        configuration.name,
        found.freq_hz,
        found.zeta,
        sure.freq_std,
        sure.zeta_std,
        elastic.coordinates,
        shapes,
        stores=(*(names[spring] for spring in energy.springs), load_name(robot)),
        energy=np.vstack([energy.share, energy.load]),
        drawing=mode_drawing(stick_figure(robot, point.q[:n_l]), shapes[:n_l], robot.gravity),
    )


def summary(
    study: Study,
    result: FitResult,
    mode_rows: Sequence[ModeRow],
    agreements: Sequence[Agreement],
    notes: Sequence[Note],
    friction: FrictionTakenOut | None = None,
) -> dict[str, Any]:
    """The content of summary.json; notes of the fit come first, then those of friction and of measured responses."""
    every = (*result.notes, *(friction.notes if friction is not None else ()), *notes)
    return {
        "schema": SCHEMA,
        "study": study.name,
        "status": result.status,
        "message": result.message,
        "cost": finite(result.cost),
        "cost_expected": finite(result.cost_expected),
        "dof": result.dof,
        "starts": len(result.starts),
        "hits": result.hits,
        "parameters": _parameters(study, result, friction),
        "friction": friction_summary(study.as_robot(), friction),
        "correlations_above_0.9": _correlations(result),
        "modification_indices": [_modification(result, one) for one in result.indices],
        "modes": [
            {
                "configuration": row.configuration,
                "frequency_hz": all_finite(row.frequency_hz.tolist()),
                "damping_ratio": all_finite(row.damping_ratio.tolist()),
            }
            for row in mode_rows
        ],
        "frf_error": [
            {
                "configuration": agreement.configuration,
                "rms_log_db": finite(agreement.overall_rms_log_db),
                "phase_rms_deg": finite(agreement.overall_phase_rms_deg),
                "inside_2sigma": finite(agreement.overall_inside_2sigma),
            }
            for agreement in agreements
        ],
        "warnings": [str(group) for group in grouped(every)],
        "notes": note_entries(every),
    }


def write_summary(path: Path, content: Mapping[str, Any]) -> None:
    """A summary as JSON, whole or not at all."""
    with text_file(path) as file:
        json.dump(content, file, indent=1, allow_nan=False)
        file.write("\n")


def failure(study: Study, message: str) -> dict[str, Any]:
    """summary.json of a fit that found nothing: the same keys, no numbers."""
    return {
        "schema": SCHEMA,
        "study": study.name,
        "status": "failed",
        "message": message,
        "cost": None,
        "cost_expected": None,
        "dof": None,
        "starts": study.fit.starts,
        "hits": 0,
        "parameters": {},
        "friction": None,
        "correlations_above_0.9": [],
        "modification_indices": [],
        "modes": [],
        "frf_error": [],
        "warnings": [],
        "notes": [],
    }


def interrupted(study: Study, ends: Sequence[LocalOptimum]) -> dict[str, Any]:
    """summary.json of a fit that was stopped: where the best of the starts that were done ended, without intervals."""
    best = failure(study, f"interrupted after {len(ends)} of {study.fit.starts} starts; run the fit again to resume it")
    if not ends:
        return best | {"status": "interrupted"}
    parameters = choose(study.fit, study.as_robot(), tuple(study.experiment.configurations))
    values, x_start = parameters.as_dict(ends[0].x), parameters.as_dict()
    rows = {
        p.name: {"value": values[p.name], "std": None, "interval95": [None, None], "unit": p.unit, "at_bound": False}
        | {"start": x_start[p.name]}
        for p in parameters.free
    }
    return best | {"status": "interrupted", "cost": finite(ends[0].cost), "parameters": rows}


def validation_summary(study: Study, validation: Validation, twin: TwinFindings = NO_TWIN) -> dict[str, Any]:
    """The content of validation.json: that of validation.h5 without its curves.

    configurations: FRF errors, of the fit or, where left_out, of the prediction.  replays: the fit in time in percent,
    row by row of its records, column by column of its outputs.  folds: errors of each configuration under the fit to
    the others; null where there was none, and message says why.  Empty lists where nothing was replayed or left out in
    turn; verdict, cost, replayed and folded: the same in words.  torque: what each part of the model explains.
    twin: how far the model is off when it is simulated along a record.
    """
    return {
        "schema": SCHEMA,
        "study": study.name,
        "verdict": validation.verdict,
        "cost": validation.cost,
        "configurations": [
            {
                "configuration": agreement.configuration,
                "left_out": bool(agreement.left_out),
                "rms_log_db": finite(agreement.overall_rms_log_db),
                "phase_rms_deg": finite(agreement.overall_phase_rms_deg),
                "inside_2sigma": finite(agreement.overall_inside_2sigma),
                "inside_2sigma_expected": finite(agreement.inside_expected),
            }
            for agreement in validation.configurations
        ],
        "replayed": validation.replayed,
        "replays": [_replay(replay) for replay in validation.replays],
        "torque": balance_entries(twin.balances),
        "twin": run_entries(twin.runs),
        "folded": validation.folded,
        "folds": [
            {
                "configuration": fold.configuration,
                "misfit": finite(fold.misfit),
                "rms_log_db": finite(fold.rms_log_db),
                "phase_rms_deg": finite(fold.phase_rms_deg),
                "message": fold.message,
            }
            for fold in validation.folds
        ],
    }


def _replay(replay: Replay) -> dict[str, Any]:
    return {
        "configuration": replay.configuration,
        "quantity": replay.quantity,
        "band_hz": all_finite(replay.band_hz),
        "records": list(replay.records),
        "outputs": list(replay.outputs),
        "fit_percent": [all_finite(row) for row in replay.fit_percent.tolist()],
        "reachable_percent": [all_finite(row) for row in replay.reachable_percent.tolist()],
    }


def _parameters(study: Study, result: FitResult, friction: FrictionTakenOut | None) -> dict[str, dict[str, Any]]:
    rows = parameter_rows(result, truth(study, friction), contents(study, friction, result.parameters.free))
    return {
        row.name: {
            "value": row.estimate,
            "std": finite(row.std),
            "interval95": all_finite(row.interval),
            "unit": row.unit,
            "at_bound": row.at_bound,
            "start": row.start,
            **({} if row.truth is None else {"truth": row.truth}),
            **({"contains": row.contains} if row.contains else {}),
            **_further(result, row.name),
        }
        for row in rows
    }


def _further(result: FitResult, name: str) -> dict[str, Any]:
    """Intervals by other ways, where the study asks for them."""
    if name not in result.parameters.free_names:
        return {}
    i = result.parameters.free_names.index(name)
    found: dict[str, Any] = {}
    for key in ("profile95", "bootstrap95"):
        ends = getattr(result, key)
        if len(ends) and not np.isnan(ends[i]).any():
            found[key] = all_finite(ends[i].tolist())
    return found


def _modification(result: FitResult, one: ModificationIndex) -> dict[str, Any]:
    """One number or reading: what it was, what it would be, and what that would do; place 0 is of it alone."""
    return {
        "name": one.name,
        "group": one.group,
        "place": one.place,
        "share": finite(one.share),
        "drop": finite(one.drop),
        "members": [
            {"name": name, "unit": unit, "value": finite(value), "changed": finite(changed)}
            for name, unit, value, changed in zip(one.members, one.units, one.values.tolist(), one.changed, strict=True)
        ],
        "alike": list(one.alike),
        "effects": dict(zip(result.parameters.free_names, all_finite(one.effects.tolist()), strict=True)),
    }


def _correlations(result: FitResult) -> list[list[Any]]:
    names, r = result.parameters.free_names, result.correlation
    above = np.argwhere(np.triu(np.abs(r), 1) > CORRELATED)
    return [[names[i], names[j], round(float(r[i, j]), 4)] for i, j in above]
