"""A FrequencyResponse with the names, units and configuration of the records that it was estimated from."""

from __future__ import annotations

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.record import Motion, Record
from elastid.response import Covariance, FrequencyResponse, Quality


def measured_response(
    first: Record,
    quantity: Motion,
    freq_hz: FloatArray,
    G: ComplexArray,
    noise: Covariance | None = None,
    total: Covariance | None = None,
    quality: Quality | None = None,
    notes: tuple[Note, ...] = (),
) -> FrequencyResponse:
    """G (F, n_y, n_u) at freq_hz (F,), outputs as `quantity`; first: of records that agree in all but their signals."""
    return FrequencyResponse(
        freq_hz=freq_hz,
        G=G,
        inputs=first.inputs,
        outputs=first.outputs,
        quantity=quantity,
        configuration=first.configuration,
        noise=noise,
        total=total,
        rate_is_known=first.rate_is_known,
        sliding=first.sliding,
        input_units=first.input_units,
        quality=quality,
        notes=notes,
        hold=first.images,
    )
