"""Terms of the status of a fit: its values with their meaning, verdicts on parameters, codes of causes."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from elastid.response import UNEXPLAINED

# misfit: the model explains most of the response, but its error exceeds the intervals by noise.
# model_error: the model at the optimum explains less than half of the measured response.
Status: TypeAlias = Literal[
    "converged", "noise_unknown", "at_bound", "misfit", "not_converged", "ill_conditioned", "model_error"
]

# Limit of the ratio of residuals to noise and declared model error, and of residuals to noise.
LARGE = 1.5


@dataclass(frozen=True)
class Meaning:
    """Meaning of a status for the parameters, with the next action; both without full stops."""

    clause: str
    action: str

    def __str__(self) -> str:
        return f"{self.clause}. {self.action}"


# Meanings of all statuses but `converged`, whose meaning depends on the parameters.
MEANING: dict[Status, Meaning] = {
    "noise_unknown": Meaning(
        "no residual test, because the responses have no covariance; the intervals are computed from the residuals",
        "To test the model, measure two periods or more, or give the covariance",
    ),
    "at_bound": Meaning(
        "a parameter ended at its bound, and the others are estimated with this value",
        "Widen the bound; if the estimate then ends at the new bound, the model may lack an effect",
    ),
    "misfit": Meaning(
        "significant model error: the estimates can be biased; do not use the results",
        "Correct the likely cause, and fit again",
    ),
    "not_converged": Meaning(
        "the search stopped before an optimum", "Give it more starts, or start values nearer to the robot"
    ),
    "ill_conditioned": Meaning(
        "the data do not determine all parameters", "Fix or tie those that are named, or give a prior"
    ),
    "model_error": Meaning(
        "the model does not describe these responses: do not use its parameters",
        "Check channels, configurations and robot model",
    ),
}

# Meaning of a misfit whose residuals are consistent with the noise.
CONTRADICTED = Meaning("the data contradict a value of the robot model", "Correct or estimate the value, and fit again")

# Code of the note on undetectable errors of fixed values.
FIXED_VALUES = "fit/fixed-values"

# Codes of notes on causes of model errors; each note has a remedy.
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
