"""The `validation` section of a study."""

from __future__ import annotations

from elastid.section import section


@section
class ValidationSpec:
    """left_out: configurations that the fit does not see, on which the model is then judged."""

    left_out: tuple[str, ...] = ()
