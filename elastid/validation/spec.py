"""The `validation` section of a study."""

from __future__ import annotations

from elastid.section import section


@section
class ValidationSpec:
    """left_out: configurations that the fit does not see, on which the model is then judged."""

    left_out: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse a configuration that is named twice."""
        if len(set(self.left_out)) < len(self.left_out):
            raise ValueError(f"left_out names a configuration twice ({', '.join(self.left_out)})")
