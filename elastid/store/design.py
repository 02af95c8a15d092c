"""plan.h5: the plan of an experiment, its references, rehearsal and forecast; and CSV files for a robot controller."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elastid.base.escape import csv_cell
from elastid.base.units import of_translation
from elastid.design.limit_use import QUANTITIES, UNITS, LimitUse
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.references import Reference
from elastid.experiment.plan.rehearsal import Rehearsal
from elastid.record import Configuration
from elastid.store.files import (
    NO_STAMP,
    Stamp,
    attributes,
    created,
    key,
    opened,
    read_notes,
    read_sliding,
    scale,
    text_file,
    texts,
    variable,
    write_notes,
    write_sliding,
)

if TYPE_CHECKING:
    from elastid.design.forecast import Forecast

_MOTION = (("position", "rad"), ("velocity", "rad/s"), ("acceleration", "rad/s^2"), ("feed_forward", "N*m"))
_PLAN_ATTRIBUTES = ("rate_hz", "period_samples", "periods", "transient_periods", "ramp_samples", "hold_samples")
_FORECAST = "forecast"


def write_plan(
    path: Path | str,
    plan: Plan,
    stamp: Stamp = NO_STAMP,
    references: tuple[Reference, ...] = (),
    peaks: LimitUse | None = None,
    forecast: Forecast | None = None,
    nearest: Rehearsal | None = None,
) -> None:
    """plan.h5: R (configuration, realisation, experiment, line, input) and whatever else is known of the plan.

    references: of each configuration.  peaks: of the rehearsal.  nearest: the run that comes closest to a limit.
    """
    with created(path, "plan", stamp) as file:
        _, M, E, _, _ = plan.R.shape
        angles = np.stack([c.angles for c in plan.configurations])
        configuration = scale(file, "configuration", [c.name for c in plan.configurations], "configuration")
        driven = scale(file, "driven_joint", np.arange(angles.shape[1]), "driven joint, in the robot's order")
        axes = [
            configuration,
            scale(file, "realisation", np.arange(M), "independent random phases"),
            scale(file, "experiment", np.arange(E), "experiment of a realisation"),
            scale(file, "line", plan.lines, "DFT line"),
            scale(file, "input", plan.inputs, "input"),
        ]
        variable(file, "R", plan.R, axes, "amplitude spectrum of the injected torque, link side", "N*m")
        variable(file, "freq_hz", plan.freq_hz, axes[3:4], "excited frequency", "Hz")
        variable(file, "angles", angles, [configuration, driven], "angle", "rad")
        write_sliding(file, plan.sliding)
        scale(file, "detection", plan.detection, "DFT line of the band without excitation")
        for name in _PLAN_ATTRIBUTES:
            file.attrs[name] = getattr(plan, name)
        _write_references(file, references, axes[4])
        if peaks is not None:
            _write_peaks(file, peaks, configuration, axes[4])
        if forecast is not None:
            _write_forecast(file.create_group(_FORECAST), forecast)
        if nearest is not None:
            _write_rehearsal(file, nearest, axes[4])


def read_plan(path: Path | str) -> Plan:
    """The plan in plan.h5."""
    with opened(path, "plan") as file:
        known = attributes(file)
        configurations = zip(texts(file, "configuration"), file["angles"][:], strict=True)
        return Plan(
            configurations=tuple(Configuration(name, angles) for name, angles in configurations),
            inputs=texts(file, "input"),
            lines=file["line"][:],
            R=file["R"][:],
            detection=file["detection"][:],
            sliding=read_sliding(file),
            **{name: known[name] for name in _PLAN_ATTRIBUTES},
        )


def _write_references(file: Any, references: tuple[Reference, ...], inputs: Any) -> None:
    """A group for each configuration in the open plan.h5."""
    for reference in references:
        group = file.create_group(f"reference/{key(reference.configuration.name)}")
        t = (np.arange(len(reference.scale)) - reference.first_sample) / reference.rate_hz
        time = scale(group, "time", t, "time, 0 where the periods begin", "s")
        variable(group, "scale", reference.scale, [time], "factor on the experiment's torque, 0 at rest")
        for what, unit in _MOTION:
            words = f"{what.replace('_', '-')} {'torque' if unit == 'N*m' else ''}".strip()
            variable(group, what, getattr(reference, what), [time, inputs], f"{words} of each motor, link side", unit)


def _write_peaks(file: Any, peaks: LimitUse, configurations: Any, inputs: Any) -> None:
    """The peaks of the rehearsal in the open plan.h5."""
    group = file.create_group("peaks")
    group.attrs["margin"] = peaks.margin
    quantity = scale(group, "quantity", QUANTITIES, "limited quantity")
    variable(group, "unit", UNITS, [quantity], "unit of each quantity, link side")
    axes = [configurations, quantity, inputs]
    variable(group, "peak", peaks.peak, axes, "largest value of any experiment in the rehearsal")
    variable(group, "limit", peaks.limit, axes, "limit, infinite where there is none")
    variable(group, "factor", peaks.factor, [configurations, inputs], "factor on the amplitudes that the study gives")
    group.attrs["nearest"] = peaks.nearest
    write_notes(group, peaks.notes)


def read_peaks(path: Path | str) -> LimitUse:
    """The peaks of the rehearsal in plan.h5."""
    with opened(path, "plan") as file:
        group = file["peaks"]
        return LimitUse(
            texts(file, "configuration"),
            texts(file, "input"),
            group["peak"][:],
            group["limit"][:],
            group["factor"][:],
            float(group.attrs["margin"]),
            read_notes(group),
            str(group.attrs["nearest"]),
            read_sliding(file),
        )


def _write_rehearsal(file: Any, run: Rehearsal, inputs: Any) -> None:
    """The run that comes closest to a limit in the open plan.h5."""
    group = file.create_group("rehearsal")
    for name in ("realisation", "experiment"):
        group.attrs[name] = getattr(run.experiment, name)
    group.attrs["configuration"] = run.experiment.configuration.name
    group.attrs["rate_hz"], group.attrs["first_sample"] = run.rate_hz, run.first_sample
    time = scale(group, "time", run.time_s, "time, 0 where the periods begin", "s")
    variable(group, "position", run.position, [time, inputs], "angle of each motor, link side", "rad")
    variable(group, "torque", run.torque, [time, inputs], "torque of each motor, link side", "N*m")


def read_rehearsal(path: Path | str) -> Rehearsal:
    """The run that comes closest to a limit."""
    with opened(path, "plan") as file:
        group = file["rehearsal"]
        known = attributes(group)
        index = texts(file, "configuration").index(known["configuration"])
        configuration = Configuration(known["configuration"], file["angles"][index])
        return Rehearsal(
            Experiment(configuration, known["realisation"], known["experiment"]),
            known["rate_hz"],
            known["first_sample"],
            group["position"][:],
            group["torque"][:],
        )


def _write_forecast(group: Any, forecast: Forecast) -> None:
    """Fill the group of an open plan.h5."""
    parameter = scale(group, "parameter", forecast.parameters, "parameter that the fit identifies")
    configuration = scale(group, "fitted_configuration", forecast.configurations, "configuration that the fit uses")
    frequency = scale(group, "freq_hz", forecast.freq_hz, "excited frequency", "Hz")
    blind = scale(group, "direction", np.arange(len(forecast.blind)), "direction that the plan does not inform")
    variable(group, "unit", forecast.units, [parameter], "unit of the parameter")
    variable(group, "nominal", forecast.nominal, [parameter], "value that is assumed", "SI")
    variable(group, "std", forecast.std, [parameter], "expected standard deviation", "SI")
    variable(group, "log", np.array(forecast.log), [parameter], "whether the covariance is of its logarithm")
    variable(group, "covariance", forecast.covariance, [parameter, parameter], "expected covariance of x")
    axes = [configuration, frequency, parameter]
    variable(group, "share", forecast.share, axes, "share of the information about a parameter")
    variable(group, "blind", forecast.blind, [blind, parameter], "relative change that the plan does not inform")
    write_notes(group, forecast.notes)
    if forecast.choice:
        group.attrs["choice"] = forecast.choice


def read_forecast(path: Path | str) -> Forecast | None:
    """The forecast in plan.h5; None where there is none."""
    from elastid.design.forecast import Forecast  # brings the fit, which a reader of the plan does not need

    with opened(path, "plan") as file:
        if _FORECAST not in file:
            return None
        group = file[_FORECAST]
        return Forecast(
            parameters=texts(group, "parameter"),
            units=texts(group, "unit"),
            nominal=group["nominal"][:],
            log=tuple(group["log"][:].tolist()),
            covariance=group["covariance"][:],
            configurations=texts(group, "fitted_configuration"),
            freq_hz=group["freq_hz"][:],
            share=group["share"][:],
            blind=group["blind"][:],
            notes=read_notes(group),
            choice=str(attributes(group).get("choice", "")),
        )


def write_movement(path: Path, reference: Reference, inputs: tuple[str, ...], sliding: tuple[str, ...] = ()) -> None:
    """A whole run in one configuration as CSV; the periods begin at time 0, and the scale is that of their torque.

    sliding: inputs that translate.
    """
    units = {place: of_translation if place in sliding else str for place in inputs}
    columns = [f"{what} of {place} ({units[place](unit)}, link side)" for what, unit in _MOTION for place in inputs]
    rows = np.column_stack([reference.scale, *(getattr(reference, what) for what, _ in _MOTION)])
    _write_csv(path, ["torque scale", *columns], rows, reference.rate_hz, reference.first_sample)


def write_torque(path: Path, plan: Plan, experiment: Experiment) -> None:
    """One period of the torques to inject as CSV, repeated from time 0 of the movement on, and backwards before it."""
    columns = [f"{place} ({'N' if place in plan.sliding else 'N*m'}, link side)" for place in plan.inputs]
    _write_csv(path, columns, plan.torque(experiment), plan.rate_hz, 0)


def _write_csv(path: Path, columns: list[str], rows: Any, rate_hz: float, first_sample: int) -> None:
    line = ",".join(["%.9g"] * (1 + len(columns))) + "\n"
    with text_file(path) as file:
        csv.writer(file, lineterminator="\n").writerow(["time_s", *map(csv_cell, columns)])
        file.writelines(line % ((i - first_sample) / rate_hz, *row) for i, row in enumerate(rows.tolist()))
