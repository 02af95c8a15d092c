"""Figures for notebooks. Each function returns a matplotlib.figure.Figure.

Examples
--------
>>> from elastid import Configuration, plot
>>> G = np.ones((2, 1, 1), complex)
>>> posture = Configuration("bench", [0.0])
>>> response = Response(np.array([5.0, 6.0]), G, ("motor 1",), ("motor 1",), "position", posture)
>>> len(plot.bode(response).axes)
2
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from elastid.base.errors import check_kind, index_of
from elastid.fit.result import Result
from elastid.friction_study.result import FrictionResult
from elastid.linear.fitted_model import FittedModel
from elastid.report.figures import fit
from elastid.report.figures.fit import forest
from elastid.report.figures.friction import friction_curve as curve_figure
from elastid.report.figures.style import default_style
from elastid.report.figures.use import workspace_figure
from elastid.report.parameter_row import parameter_rows
from elastid.response import Response, in_quantity
from elastid.use.map import WorkspaceMap

__all__ = ["bode", "friction_curve", "parameters", "workspace"]


@default_style()
def bode(measured: Response, model: FittedModel | Response | None = None, *, band: bool = True) -> Figure:
    """Plot magnitude and phase of a measured response and a model, one panel per element.

    Parameters
    ----------
    measured : Response
        Measured response.
    model : FittedModel, Response or None
        Fitted model, drawn on dense lines; or another response, drawn on its lines.
    band : bool
        Draw a band of two standard deviations of a fitted model.

    Raises
    ------
    ValueError
        If inputs, outputs or configurations of the two differ.
    TypeError
        For other values.
    """
    check_kind(measured, Response, "measured", "read_responses gives one for each configuration")
    if model is None:
        return fit.bode(measured, None, None)
    check_kind(model, FittedModel | Response, "model", "result.model(configuration) makes one")
    modelled, std = (model, None) if isinstance(model, Response) else _on_dense_lines(model, measured, band)
    if (modelled.inputs, modelled.outputs) != (measured.inputs, measured.outputs):
        raise ValueError(
            f"the model has inputs {', '.join(modelled.inputs)} and outputs {', '.join(modelled.outputs)}, the "
            f"measured response {', '.join(measured.inputs)} and {', '.join(measured.outputs)}"
        )
    measured_at, modelled_at = measured.configuration, modelled.configuration
    if isinstance(model, FittedModel) and not np.array_equal(measured_at.angles, modelled_at.angles):
        raise ValueError(
            f"the model is of configuration {modelled_at.name}, the measured response of {measured_at.name}; take "
            f"result.model('{measured_at.name}')"
        )
    return fit.bode(measured, in_quantity(modelled, measured.quantity), std)


@default_style()
def parameters(result: Result, truth: Mapping[str, float] | None = None) -> Figure:
    """Plot start, estimate and 95 % interval of each free parameter.

    Parameters
    ----------
    result : Result
        Result of a fit.
    truth : mapping of str to float, or None
        True values in SI by name, if known.

    Raises
    ------
    UnknownNameError
        For a true value of an unknown parameter.
    """
    check_kind(result, Result, "result", "elastid.identify(...) and elastid.load(path) give one")
    for name in truth or ():
        index_of(name, list(result.values), "parameter")
    return forest(parameter_rows(result, truth))


@default_style()
def friction_curve(result: FrictionResult, joint: str) -> Figure:
    """Plot measured friction torque and friction model of one joint over speed, with the 95 % band.

    Parameters
    ----------
    result : FrictionResult
        Result of a friction study.
    joint : str
        Name of the joint.

    Raises
    ------
    UnknownNameError
        For a joint whose friction was not identified.
    ValueError
        If the data do not identify friction over speed.
    """
    check_kind(result, FrictionResult, "result", "identify_friction and read_friction_result make one")
    law = result.at(joint).static
    if law is None:
        raise ValueError(f"the data identify no law of friction over speed of joint {joint}: {result.message}")
    return curve_figure(law)


@default_style()
def workspace(mapped: WorkspaceMap, quantity: str = "softest_compliance") -> Figure:
    """Plot a workspace map from above and from the side, with the most compliant posture marked.

    Parameters
    ----------
    mapped : WorkspaceMap
        Map of compliance or natural frequencies.
    quantity : str
        Quantity of the map that gives the colours.

    Raises
    ------
    UnknownNameError
        For a quantity that the map lacks.
    """
    check_kind(mapped, WorkspaceMap, "mapped", "map_workspace makes one")
    index_of(quantity, [q.name for q in mapped.quantities], "quantity")
    return workspace_figure(mapped, quantity)


def __dir__() -> list[str]:
    return __all__


def _on_dense_lines(model: FittedModel, measured: Response, band: bool) -> tuple[Response, np.ndarray | None]:
    """Return the response of a model, and its standard deviation, on the measured lines and many between them."""
    low, high = measured.freq_hz[[0, -1]]
    lines = np.union1d(measured.freq_hz, np.geomspace(low, high, 1000))
    is_same_quantity = model.linear.quantity == measured.quantity
    return model.response(lines, sampled=True), model.response_std(lines) if band and is_same_quantity else None
