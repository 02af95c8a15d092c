"""FrequencyResponse: G(j omega) of one configuration, measured and modelled alike, its covariance and its quality."""

from elastid.response.covariance import Covariance, CovarianceForm
from elastid.response.quality import LINE_ARRAYS, Levels, Quality
from elastid.response.response import FrequencyResponse, in_quantity

__all__ = ["LINE_ARRAYS", "Covariance", "CovarianceForm", "FrequencyResponse", "Levels", "Quality", "in_quantity"]
