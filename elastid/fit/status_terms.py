"""Terms of the status of a fit: its values with their meaning, verdicts on parameters, codes of causes."""

from typing import Literal, TypeAlias

from elastid.response import UNEXPLAINED

# misfit: the model explains most of the response, but its error exceeds the intervals by noise.
# model_error: the model at the optimum explains less than half of the measured response.
Status: TypeAlias = Literal[
    "converged", "noise_unknown", "at_bound", "misfit", "not_converged", "ill_conditioned", "model_error"
]

# Limit of the ratio of residuals to noise and declared model error, and of residuals to noise.
LARGE = 1.5

# The meaning for the parameters; after the full stop the next action.
MEANING: dict[Status, str] = {
    "converged": "all parameters identified. Use them with their intervals",
    "noise_unknown": "no residual test, because the responses have no covariance; the intervals are computed from the "
    "residuals. To test the model, measure two periods or more, or give the covariance",
    "at_bound": "a parameter ended at its bound, and the others are estimated with this value. Widen the bound; if the "
    "estimate then ends at the new bound, the model may lack an effect",
    "misfit": "significant model error: the estimates can be biased; do not use the results. Correct the likely cause, "
    "and fit again",
    "not_converged": "the search stopped before an optimum. Give it more starts, or start values nearer to the robot",
    "ill_conditioned": "the data do not determine all parameters. Fix or tie those that are named, or give a prior",
    "model_error": "the model does not describe these responses: do not use its parameters. Check channels, "
    "configurations and robot model",
}

# Meaning of a misfit whose residuals are consistent with the noise.
CONTRADICTED = "the data contradict a value of the robot model. Correct or estimate the value, and fit again"

# Code of the note on undetectable errors of fixed values.
FIXED_VALUES = "fit/fixed-values"

# Codes of notes on causes of model errors: two sentences each, the cause and its remedy.
CAUSES = (
    "fit/frequency-unit", "fit/likely-cause", "fit/inconsistent-responses", "fit/loads", "fit/tool",
    "fit/prior-contradicted", "fit/tolerances",
)  # fmt: skip

# Codes of notes whose cause gear effects can be.
CODES_WITH_CAUSE = ("fit/likely-cause", "fit/profile", UNEXPLAINED)

NO_CAUSE = "no tested cause explains the residuals above the noise"

REQUIRED = "the data require"  # beginning of a cause that the fit includes

OTHER_JOINTS = (
    "Add the joints that may be elastic to the robot model, and search among them: `elastid compare STUDY --search`"
)

OTHER_AMPLITUDE = (
    "To find the cause of the model error, measure again at half the torque. If the residuals relative "
    "to |G| change, the cause is nonlinear; otherwise it is linear, for example a missing elastic joint"
)

# Verdicts on a parameter; BIASED is followed by the reason.
GOOD, BY_PRIOR, AT_BOUND, BIASED = "good", "dominated by the prior", "at its bound", "biased"

UNCERTAIN = "weakly identifiable: std above 50 %"

DISTORTED = f"{BIASED}: inconsistent records, gear hysteresis or a nonlinear spring"
