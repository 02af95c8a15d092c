"""What a motion about a posture adds to a response that came without an uncertainty."""

from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linear_model import LinearModel
from elastid.linear.motion_bias import estimate_motion_bias
from elastid.linear.response.transfer import to_response
from elastid.model.elastic import ElasticModel
from elastid.response import MotorMotion


def posture_effect(
    model: ElasticModel, linear: LinearModel, theta: FloatArray, motion: MotorMotion, freq_hz: FloatArray
) -> ComplexArray:
    """dG (F, n_y, n_u); zero without a motion."""
    response = replace(to_response(linear, theta, freq_hz), motion=motion)
    effect = estimate_motion_bias(model, linear, theta, response)
    return np.zeros_like(response.G) if effect is None else effect
