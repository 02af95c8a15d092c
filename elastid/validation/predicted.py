"""Responses measured at the tool, by a hammer or an accelerometer, next to the prediction of `Result.at` with its band.

The prediction has the errors of parameters, of the robot's file and of a misfit.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.statistics import LEVEL
from elastid.fit.posture import Asked, as_configuration
from elastid.fit.result import Result
from elastid.response import Response

# 95 % of a circular complex error are within so many times its std, sqrt(E|e|^2).
CIRCULAR_95 = float(np.sqrt(-np.log(0.05)))


@frozen_value(eq=False)
class PredictedResponse:
    """A measured response and the prediction of the fitted robot, on the same lines.

    pointwise, simultaneous (F, n_y, n_u): distances from the prediction within which the truth is with 95 %, at each
    line and at all lines of an element.  std: E|dG|^2 ^ 1/2.  motors: held, free or controlled.
    is_fitted: the response was fitted, together with those of the motors.
    """

    measured: Response
    predicted: Response
    std: FloatArray = labelled("standard deviation of the prediction")
    pointwise: FloatArray = labelled("95 % of the truth, line by line")
    simultaneous: FloatArray = labelled("95 % of the truth, all lines")
    motors: str
    by: str
    is_fitted: bool = False

    @property
    def configuration(self) -> str:
        """The name of the configuration."""
        return self.measured.configuration.name

    @property
    def measured_std(self) -> FloatArray:
        """Standard deviation (F, n_y, n_u) of the measured response, 0 where it is not known."""
        known = self.measured.uncertainty
        return np.zeros(self.measured.G.shape) if known is None else np.sqrt(known.variance)

    @property
    def inside(self) -> float:
        """Share of the lines of all elements on which both agree within their 95 % bands together."""
        radius = np.hypot(self.pointwise, CIRCULAR_95 * self.measured_std)
        return float(np.mean(np.abs(self.measured.G - self.predicted.G) <= radius))

    @property
    def rms_log_db(self) -> float:
        """Root mean square of 20 log10 of measured over predicted magnitude, of lines well above the noise."""
        judged = np.abs(self.measured.G) > 2 * self.measured_std
        ratio = np.abs(self.measured.G[judged]) / np.maximum(np.abs(self.predicted.G[judged]), 1e-300)
        return float(np.sqrt(np.mean((20 * np.log10(np.maximum(ratio, 1e-300))) ** 2))) if judged.any() else np.nan

    @property
    def words(self) -> str:
        """The comparison in a sentence."""
        places = f"{', '.join(self.measured.outputs)} by {', '.join(self.measured.inputs)}"
        return (
            f"{self.configuration}, motors {self.motors}: {places}: {self.rms_log_db:.2g} dB rms between measurement "
            f"and prediction; {100 * self.inside:.0f} % of the lines agree within both 95 % bands"
        )


def predict_response(result: Result, measured: Response, is_fitted: bool = False) -> PredictedResponse:
    """The prediction of a response, its motors as they were.

    StudyError for places that the robot lacks, and where it finds no rest.
    """
    motors, drives = measured.motors, measured.loop
    asked = Asked(measured.inputs, measured.outputs, motors, quantity=measured.quantity, controller=drives)
    family = result.family(asked, measured.configuration.name)
    where = as_configuration(measured.configuration, family.robot, ())
    band = family.at(where).response_band(measured.freq_hz, LEVEL)
    predicted = replace(band.response, configuration=measured.configuration)
    return PredictedResponse(
        measured, predicted, band.std, band.pointwise, band.simultaneous, motors, band.by, is_fitted
    )  # fmt: skip
