"""Contents of summary.json and validation.json, from fields and properties of results; rows of modes."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from elastid.app.run import Write
from elastid.base.arrays import values_by_name
from elastid.base.errors import Note, group_notes, notes_of
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.linear.fitted_model import FittedModel
from elastid.linear.modes import strain_energy
from elastid.model.elastic import ElasticModel
from elastid.model.kinematics import stick_figure
from elastid.nonlinear.compensated_friction import CompensatedFriction, friction_rows
from elastid.report.modes import ModeRow, load_name, mode_drawing, spring_names
from elastid.report.parameter_row import ParameterRow
from elastid.robot import Robot
from elastid.store.kinds import SCHEMA, json_value, write_json
from elastid.validation.frf_error import FrfError, Validation
from elastid.validation.log_comparison import NO_COMPARISON, BandBalance, LogComparison, TorqueBalance

if TYPE_CHECKING:  # these bring solvers, which a fit of elasticity does not need
    from elastid.friction_study.result import FrictionResult
    from elastid.friction_study.rigid_body_columns import RigidBody

# A part of a summary, as JSON.
Content: TypeAlias = dict[str, Any]


def modes_of(fitted: FittedRobot) -> tuple[ModeRow, ...]:
    """Return the modes of the fitted model with free motors, a row for each configuration."""
    return tuple(_mode_row(fitted.model, model) for model in fitted.models)


def _mode_row(elastic: ElasticModel, model: FittedModel) -> ModeRow:
    configuration, theta, modal = model.linear.configuration, model.theta, model.modes()
    robot, shapes = elastic.robot_at(theta[:-1]), modal.shapes
    point = equilibrium(elastic, theta[:-1], configuration)
    energy = strain_energy(elastic, theta[:-1], point, shapes)
    names, n_l = spring_names(robot), robot.n_l
    fractions = np.vstack([energy.fraction, energy.load])
    mask = fractions[-1] < 0.5  # without pendulum modes under gravity
    return ModeRow(
        *(configuration.name, modal.freq_hz[mask], modal.zeta[mask], modal.freq_std[mask], modal.zeta_std[mask]),
        *(elastic.coordinates, shapes[:, mask]),
        stores=(*(names[spring] for spring in energy.springs), load_name(robot)),
        energy=fractions[:, mask],
        drawing=mode_drawing(stick_figure(robot, point.q[:n_l]), shapes[:n_l, mask], robot.gravity),
    )


def as_json(content: Mapping[str, Any]) -> Write:
    """Return the writer of a summary as JSON; numbers that are not finite are null."""
    return lambda path, stamp: write_json(path, content)


def section(value: Any, names: str, **entries: str) -> Content:
    """Return fields and properties of a value (`name=attribute` renames); entries: names for entries of a field."""
    pairs = (name.partition("=") for name in names.split())
    content = {name: json_value(getattr(value, attribute or name)) for name, _, attribute in pairs}
    return content | {name: [section(row, keys) for row in getattr(value, name)] for name, keys in entries.items()}


_CHECK = "ratio ratio_std chi_square dof cause"


def failure(name: str, starts: int, message: str) -> Content:
    """Return summary.json of a failed fit of study `name`: the same keys without numbers."""
    lists = (
        "correlations_above_0.9", "modification_indices", "assumed_rigid", "presliding", "modes", "frf_error",
        "warnings", "notes"
    )  # fmt: skip
    numbers = dict.fromkeys(("static_loads", "tool_responses", "cost", "cost_expected", "dof"))
    empty: Content = {"parameters": {}, "nuisance_parameters": {}, "friction": None, **{key: [] for key in lists}}
    return {**_head(name, "failed", message), **numbers, "starts": starts, "n_converged_starts": 0, **empty}


def summary(
    name: str, robot: Robot, result: Result, rows: Sequence[ParameterRow], mode_rows: Sequence[ModeRow],
    agreements: Sequence[FrfError], notes: Sequence[Note], friction: CompensatedFriction | None = None,
) -> Content:  # fmt: skip
    """Return summary.json of study `name`, with rows of its free parameters and notes of its measured responses."""
    all_notes = (*result.notes, *(friction.notes if friction is not None else ()), *notes)
    names, r, n_of_interest = result.parameters.free_names, result.correlation, len(result.parameters.of_interest)
    above = np.argwhere(np.triu(np.abs(r[:n_of_interest, :n_of_interest]), 1) > 0.9)
    return failure(name, len(result.starts), result.message) | {
        **section(
            result,
            "status cost cost_expected dof n_converged_starts",
            presliding="place unit stiffness stiffness_std rate rate_std amplitude",
        ),
        "parameters": _parameters(result, rows),
        # Values of the robot model with tolerances: nominal value (file), tolerance, and estimate.
        "nuisance_parameters": {
            p.name: {
                "value": result.values[p.name],
                "std": json_value(result.std[p.name]),
                "unit": p.unit,
                "file": p.prior.mean,
                "tolerance": p.prior.std * (p.prior.mean if p.log else 1.0),
            }
            for p in result.parameters.free
            if p.is_nuisance and p.prior is not None
        },
        "friction": _friction_section(robot, friction, result.presliding_stiffness),
        "correlations_above_0.9": [[names[i], names[j], round(float(r[i, j]), 4)] for i, j in above],
        "modification_indices": [
            section(index, "name group place explained_fraction drop members alike effects")
            | {
                "members": [
                    dict(zip(("name", "unit", "value", "changed"), member, strict=True))
                    for member in zip(index.members, index.units, index.values.tolist(), index.changed, strict=True)
                ],
                "effects": dict(zip(names, json_value(index.effects), strict=True)),
            }
            for index in result.indices
        ],
        "assumed_rigid": [
            section(rigid_part, "name stiffness detection_limit")
            | {"changes": dict(zip(names[:n_of_interest], json_value(rigid_part.changes), strict=True))}
            for rigid_part in result.assumed_rigid
        ],
        # Load tests (m) and responses at the tool, compared with the responses of the motors.
        "static_loads": result.static
        and section(
            result.static,
            _CHECK,
            readings="configuration frame direction measured std by_responses by_responses_std",
        ),
        "tool_responses": result.tool
        and section(result.tool, _CHECK, responses="configuration motors inputs outputs rms_log_db"),
        "modes": [section(row, "configuration frequency_hz damping_ratio") for row in mode_rows],
        "frf_error": [section(agreement, f"configuration {_ERRORS}") for agreement in agreements],
        "warnings": [str(group) for group in group_notes(all_notes)],
        "notes": list_notes(all_notes),
    }


def validation_summary(name: str, validation: Validation, log_comparison: LogComparison = NO_COMPARISON) -> Content:
    """Return the content of validation.json: validation.h5 without curves.

    configurations: FRF errors of the fit or, for validation configurations, of the prediction.  predictions: responses
    at the tool.  log_comparison: torque fractions of model terms, and errors of the simulation along a record.
    """
    agreement = f"configuration is_validation {_ERRORS}"
    return {
        "schema": SCHEMA,
        "study": name,
        "verdict": validation.verdict,
        "configurations": [section(row, agreement) for row in validation.configurations],
        **_log_comparison(log_comparison),
        "predictions": [
            section(row, "configuration motors inside rms_log_db by is_fitted")
            | {"inputs": list(row.measured.inputs), "outputs": list(row.measured.outputs)}
            for row in validation.predictions
        ],
    }


def friction_study_summary(
    name: str, result: "FrictionResult", log_comparison: LogComparison = NO_COMPARISON,
    validation: LogComparison = NO_COMPARISON
) -> Content:  # fmt: skip
    """Return summary.json of a friction study.

    log_comparison: torque fractions of model terms, and simulation errors along the logs.  validation: the same for
    validation logs.
    """
    all_notes = (*result.notes, *notes_of(result.joints))
    measured = {joint.joint: joint.friction and joint.friction.measured for joint in result.joints}
    return _head(name, result.status, result.message) | {
        "parameters": {
            number.name: section(number, "value std interval95=low unit meaning learnt_from")
            | {"interval95": json_value((number.low, number.high))}
            | ({} if number.truth is None else {"truth": number.truth})
            for number in result.numbers
        },
        "not_identified": [
            {"joint": joint.joint} | section(row, "part=term reason")
            for joint in result.joints
            for row in joint.unidentified
        ],
        "motions": {
            joint.joint: section(joint.motion, "misfit seconds")
            | {"directions_apart": joint.motion.terms.by_direction}
            | section(joint.motion.regression, "relative_error")
            for joint in result.joints
            if joint.motion is not None
        },
        "rigid_bodies": [_rigid_body(body) for body in result.rigid_bodies],
        **_log_comparison(log_comparison),
        "validation": prediction_summary(validation),
        "measured": {
            joint: {name: json_value(ranges and getattr(ranges, name)) for name in ("speed", "load", "temperature")}
            for joint, ranges in measured.items()
        },
        "warnings": [str(group) for group in group_notes(all_notes) if group.first.severity == "warning"],
        "notes": list_notes(all_notes),
    }


def prediction_summary(prediction: LogComparison) -> Content:
    """Return the comparison with predicted logs; not_predicted: reasons by joint."""
    return {"not_predicted": dict(prediction.missing)} | _log_comparison(prediction)


def _rigid_body(body: "RigidBody") -> Content:
    keys = ("value", "std", "predicting", "unit")
    columns = (json_value(getattr(body, name)) for name in ("values", "std", "predicting", "units"))
    rows = (dict(zip(keys, row, strict=True)) for row in zip(*columns, strict=True))
    return {"joints": list(body.joints), "base_parameters": dict(zip(body.names, rows, strict=True))}


def failed_friction(name: str, message: str) -> Content:
    """Return summary.json of a failed friction study: the same keys without numbers and log comparison."""
    return _head(name, "failed", message) | {
        "parameters": {}, "not_identified": [], "motions": {}, "torque": [], "measured": {}, "rigid_bodies": [],
        "validation": None, "warnings": [], "notes": [],
    }  # fmt: skip


_ERRORS = "rms_log_db=overall_rms_log_db phase_rms_deg=overall_phase_rms_deg rms_sigma=overall_rms_sigma"


def _head(name: str, status: str, message: str) -> Content:
    return {"schema": SCHEMA, "study": name, "status": status, "message": message}


def list_notes(notes: Iterable[Note]) -> list[Content]:
    """List notes for a summary; equal notes of several places are one entry."""
    keys = "code severity places=place text=sentences"
    return [section(group.first, keys) | {"places": [*filter(None, group.places)]} for group in group_notes(notes)]


def _log_comparison(log_comparison: LogComparison) -> Content:
    """Return torque fractions, in total and by octave, and errors of simulations, without the signals."""
    signal, fractions = "signal=kind place error", "unexplained_fraction unexplained_without_friction"
    band_keys = f"low_hz high_hz power {fractions}"
    return {
        "torque": [
            section(balance, "place log")
            | _balance_fields(balance, balance, fractions)
            | {"bands": [_balance_fields(balance, band, band_keys) for band in balance.bands]}
            for balance in log_comparison.balances
        ],
        "simulation": [
            section(run, "log driven_by=drive tracking_bandwidth_hz seconds lost", signals=signal)
            for run in log_comparison.runs
        ],
    }


def _balance_fields(balance: TorqueBalance, value: TorqueBalance | BandBalance, names: str) -> Content:
    """Return fields of a torque balance or one of its bands, and the fraction of each contribution."""
    return section(value, names) | {"fractions": dict(zip(balance.parts, value.fractions, strict=True))}


def _parameters(result: Result, rows: Sequence[ParameterRow]) -> dict[str, Content]:
    return {
        row.name: section(row, "value=estimate std interval95=interval unit at_bound start")
        | {k: value for k in ("truth", "contains", "verdict") if (value := getattr(row, k)) not in (None, "")}
        | {name: json_value(part) for name, part in row.std_contributions.items()}
        | ({"std_with_base": json_value(result.std_with_base[row.name])} if result.assumed_rigid else {})
        | {
            name: json_value(ends)
            for name in ("profile95", "bootstrap95")
            for ends in getattr(result, name)[result.parameters.free_names.index(row.name) :][:1]
            if not np.isnan(ends).any()
        }
        for row in rows
    }


def _friction_section(
    robot: Robot, friction: CompensatedFriction | None, springs: Mapping[str, float]
) -> list[Content] | None:
    """Return the section `friction` of summary.json, one entry per motor; None without compensation.

    Torques and thresholds are link-side values; thresholds in rad (m), for the kind sign in rad/s (m/s).  before,
    after: unexplained torque amplitude by configuration.  coulomb: F_c on the motor side, for the robot model.
    """
    if friction is None:
        return None
    ratio = {f"motor {j.name}": abs(j.motor.ratio) for j in robot.driven if j.motor is not None}
    rows = list(zip(friction.shapes, friction.coulomb_torque.tolist(), friction.std.tolist(), strict=True))
    return [
        {
            "motor": row.place,
            "compensated": row.coulomb_torque is not None,
            **section(row, "F_c=coulomb_torque std interval95=interval unit"),
            "coulomb": None if row.coulomb_torque is None else row.coulomb_torque / ratio[row.place],
            "shapes": [
                section(shape, "kind threshold") | {"torque": torque, "std": std}
                for shape, torque, std in rows
                if shape.place == row.place and torque > 0
            ],
            "before": values_by_name(friction.configurations, friction.before[:, i]),
            "after": values_by_name(friction.configurations, friction.after[:, i]),
            "residual_power_ratio": row.residual_power_ratio,
        }
        for i, row in enumerate(friction_rows(friction, springs))
    ]
