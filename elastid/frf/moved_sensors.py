"""Moved sensors: one response from measurements with different sensor locations and the same inputs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.errors import DataError, notes_of
from elastid.covariance import Covariance
from elastid.record import Record
from elastid.response import Response


def by_outputs(records: Sequence[Record]) -> list[list[Record]]:
    """Group the records by their outputs, in order of appearance.

    Raises DataError if one of several groups lacks an input.
    """
    sets: dict[tuple[str, ...], list[Record]] = {}
    for record in records:
        sets.setdefault(record.outputs, []).append(record)
    for outputs, group in sets.items() if len(sets) > 1 else ():
        for j, place in enumerate(group[0].inputs):
            if not any(np.any(record.u[:, j]) for record in group):
                text = f"there is no file with input {place} and sensors at {', '.join(outputs)}. Add it, or make two "
                raise DataError("frf/records", text + "configurations", f"configuration {group[0].configuration.name}")
    return list(sets.values())


def stack_outputs(responses: Sequence[Response]) -> Response:
    """Return the response (F, n_y, n_u) of all outputs at the common lines of the responses.

    An output of two responses is taken from the first. Errors of different outputs are assumed independent. The result
    has no quality, systematic errors and leakage.  Raises DataError without a common line.
    """
    first = responses[0]
    freq_hz = first.freq_hz
    for other in responses[1:]:
        freq_hz = np.intersect1d(freq_hz, other.freq_hz)
    if not len(freq_hz):
        raise DataError("frf/records", "the measurements have no line in common. Give all of them one period")
    names = []
    blocks = []
    for response in responses:
        new = [location for location in response.outputs if location not in names]
        names += new
        blocks += [response.lines(np.isin(response.freq_hz, freq_hz))[new, first.inputs]] if new else []
    return replace(
        blocks[0],
        freq_hz=freq_hz,
        G=np.concatenate([block.G for block in blocks], axis=1),
        outputs=tuple(names),
        noise=_covariance([block.noise for block in blocks]),
        total=_covariance([block.total for block in blocks]),
        sliding=tuple(dict.fromkeys(location for block in blocks for location in block.sliding)),
        leakage=None,
        notes=tuple(dict.fromkeys(notes_of(responses))),
        correlated_lines=max(block.correlated_lines for block in blocks),
    )


def _covariance(terms: Sequence[Covariance | None]) -> Covariance | None:
    available = [term for term in terms if term is not None]
    if len(available) < len(terms):
        return None
    variance = np.concatenate([term.variance for term in available], axis=1)
    return Covariance(
        variance, min(term.dof for term in available), averaging_lines=max(term.averaging_lines for term in available)
    )
