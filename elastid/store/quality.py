"""The quality of a response in frf.h5."""

from __future__ import annotations

from typing import Any

from elastid.response import LINE_ARRAYS, FrequencyResponse, Levels, Quality
from elastid.store.files import scale, variable

_LEVELS = {
    "excited": "outputs at the excited lines",
    "even": "nonlinear distortion of even order, at even lines",
    "odd": "nonlinear distortion of odd order, at odd lines that were not excited",
}


def write_quality(group: Any, response: FrequencyResponse, frequency: Any, outputs: Any, inputs: Any) -> None:
    """The quality of a response, if it has one, on the axes of the response."""
    quality = response.quality
    if quality is None:
        return
    part, unit = group.create_group("quality"), response.output_unit
    drives = " or ".join(dict.fromkeys(response.units_of_inputs))
    ranks = scale(part, "rank", list(range(quality.singular_values.shape[1])), "singular value, largest first")
    input_ranks = scale(part, "input_rank", list(range(len(response.inputs))), "singular value, largest first")
    for name, axes, what, units in (
        ("coherence", [frequency, outputs, inputs], "coherence of one output and one input", ""),
        ("multiple_coherence", [frequency, outputs], "coherence of one output and all inputs", ""),
        ("singular_values", [frequency, ranks], "singular values of G", response.unit),
        ("input_singular_values", [frequency, input_ranks], "singular values of the inputs over their RMS", ""),
        ("input_noise", [frequency, inputs], "noise variance of the inputs in one period", f"({drives})^2"),
        ("output_noise", [frequency, outputs], "noise variance of the outputs in one period", f"({unit})^2"),
    ):
        variable(part, name, getattr(quality, name), axes, what, units)
    variable(part, "condition", quality.condition, [frequency], "condition of the inputs over their RMS")
    if quality.stochastic is not None:
        what = "RMS amplitude of stochastic nonlinear distortion in the outputs"
        variable(part, "stochastic", quality.stochastic, [frequency, outputs], what, unit)
    for name, what in _LEVELS.items():
        levels: Levels | None = getattr(quality, name)
        if levels is not None:
            at = part.create_group(name)
            own = scale(at, "freq_hz", levels.freq_hz, "frequency", "Hz" if response.rate_is_known else "sampling rate")
            variable(at, "amplitude", levels.amplitude, [own, outputs], f"RMS amplitude: {what}", unit)
            variable(at, "noise", levels.noise, [own, outputs], "standard deviation of the noise in it", unit)


def read_quality(group: Any) -> Quality | None:
    """The quality in the group of a response; None without one."""
    if "quality" not in group:
        return None
    part = group["quality"]

    def levels(name: str) -> Levels | None:
        return Levels(*(part[name][field][:] for field in ("freq_hz", "amplitude", "noise"))) if name in part else None

    excited = levels("excited")
    assert excited is not None
    return Quality(
        **{name: part[name][:] for name in LINE_ARRAYS},
        excited=excited,
        stochastic=part["stochastic"][:] if "stochastic" in part else None,
        even=levels("even"),
        odd=levels("odd"),
    )
