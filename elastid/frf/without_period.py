"""Responses of records without a period: by Welch's method from segments, or by a local method from each as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.excitation.grids import grid_lines
from elastid.frf.checks.exchanged_channels import channel_notes
from elastid.frf.local.response import local_response
from elastid.frf.spec import EstimatorSpec, Method
from elastid.frf.spectra import refuse_uncomputable
from elastid.frf.welch import welch_response
from elastid.record import Record
from elastid.response import FrequencyResponse

WELCH = ("h1", "h2", "hv")
_LOCAL = ("local_polynomial", "local_rational")
# Lines that `auto` gives to a local method, at most: about half a minute for one input.
_MAX_LOCAL_LINES = 50_000
# Records of this part of the longest are cut to one length for a local method; shorter ones are refused.
_MIN_LENGTH_SHARE = 0.5


def response_without_period(records: Sequence[Record], spec: EstimatorSpec) -> FrequencyResponse:
    """G (F, n_y, n_u) of one configuration from its records without a period, each a realisation.

    Raises StudyError where the spec asks for periods, DataError where the records do not suffice.
    """
    _refuse_periods(records, spec)
    for record in records:
        refuse_uncomputable(record)
    method, notes = choose_without_period(records, spec)
    spec = replace(spec, method=method, transient_periods="auto")
    if method in WELCH:
        response = welch_response(records, spec)
    else:
        records, cut = _of_one_length(records)
        notes = (*notes, *cut)
        response = local_response(records, replace(spec, lines="full"))
    return replace(response, notes=(*notes, *response.notes, *channel_notes(response)))


def choose_without_period(records: Sequence[Record], spec: EstimatorSpec) -> tuple[Method, tuple[Note, ...]]:
    """The method that the spec names; for `auto` a local one, or h1 for long records, with the reason as a note."""
    if spec.method != "auto":
        return spec.method, ()
    first = records[0]
    shortest = min(record.n_samples for record in records)
    band_hz = spec.band_hz or (0.0, first.rate_hz / 2)
    count = len(grid_lines("full", band_hz, first.rate_hz, shortest))
    known = all(record.r is not None for record in records)
    method: Method
    if count > _MAX_LOCAL_LINES and spec.resolution_hz is None and not known:
        method = "h1"
        reason = f"a local method would fit {count} lines, and records so long leave many segments"
    else:
        method = "local_rational"
        reason = "it needs no period, and a start from rest is part of its model, which segments take for noise"
        if known:
            reason += "; by the reference r, so that noise in the loop biases nothing"
    text = f"estimator.method auto takes {method}: the records have no period; {reason}"
    return method, (Note("method-chosen", text, severity="information"),)


def _refuse_periods(records: Sequence[Record], spec: EstimatorSpec) -> None:
    """StudyError for a method, lines or a transient that only records with a period have."""
    name = records[0].name
    if spec.method not in ("auto", *_LOCAL, *WELCH):
        raise StudyError(
            f"record {name} has no period, which estimator.method {spec.method} needs; take auto, local_rational, "
            "local_polynomial, h1, h2 or hv, or state the period of the record where it has one"
        )
    if spec.lines in ("odd", "excited"):
        raise StudyError(
            f"record {name} has no period, and so no lines that are {spec.lines}; take estimator.lines full, and "
            "band_hz for the band that was excited"
        )
    if spec.transient_periods not in ("auto", 0):
        raise StudyError(
            f"record {name} has no period, so that transient_periods {spec.transient_periods} has no meaning; leave "
            "the key out, and cut the start of the file with samples: [first, last]"
        )


def _of_one_length(records: Sequence[Record]) -> tuple[Sequence[Record], tuple[Note, ...]]:
    """The records cut to the shortest, since a local method compares them line by line, and a note on it."""
    lengths = np.array([record.n_samples for record in records])
    n = int(lengths.min())
    if np.all(lengths == n):
        return records, ()
    first = records[0]
    where = f"configuration {first.configuration.name}"
    seconds = f"{n / first.rate_hz:g} to {lengths.max() / first.rate_hz:g} s"
    if n < _MIN_LENGTH_SHARE * lengths.max():
        raise DataError(
            f"{where}: its records last {seconds}, and a local method needs one length: cut them with "
            "samples: [first, last], or take estimator.method h1"
        )
    text = f"records of {seconds} are cut to the shortest, since a local method compares them line by line"
    return [_cut(record, n) for record in records], (Note("records-cut", text, where),)


def _cut(record: Record, n: int) -> Record:
    r = None if record.r is None else record.r[:n]
    return replace(record, u=record.u[:n], y=record.y[:n], r=r, period_samples=n)
