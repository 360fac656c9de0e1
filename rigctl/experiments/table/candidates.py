"""What an effect would do to the residuals, told apart from what the model holds already without loss of digits."""

from __future__ import annotations

import numpy as np

from rigctl.core.arrays import FloatArray
from rigctl.core.errors import DataError
from rigctl.experiments.table.model.form import Form
from rigctl.experiments.table.model.pieces import PluginPiece
from rigctl.experiments.table.model.start import span_of
from rigctl.workbench.study import Candidate, NotTestable, Term

_HELD = 1e-7
"""A function belongs to what the model spans when less than this share of it sticks out."""


def candidate_of(form: Form, term: Term, response_unit: str, held: FloatArray, left: FloatArray) -> Candidate:
    """A form as a candidate beside a model whose derivatives span `held` (n, rank) and that leaves `left` (n,).

    A square of years from 1950 to 2020 is all but a multiple of the years: its derivative is given without the
    constant, the line and so on *where the model spans these*, which changes neither what the effect explains nor its
    estimate, and keeps its size honest.
    """
    derivative = _without_trivial(form, form.parts(term.choice), held)
    return Candidate(
        term,
        tuple(f"{term.effect}{name}" for name in form.names()),
        form.units(response_unit),
        derivative,
        _rms(left) / np.maximum(_rms(derivative), np.finfo(np.float64).tiny),
    )


def plugin_candidate(piece: PluginPiece, signal: FloatArray) -> Candidate | NotTestable:
    """A plug-in as a candidate where the baseline predicts `signal`."""
    none = np.zeros(len(piece.units))
    try:
        derivative = piece.slopes(none, signal)
    except DataError as error:
        return NotTestable(piece.term.effect, str(error))
    if not np.isfinite(derivative).all():
        return NotTestable(piece.term.effect, "it gives no finite number in some readings")
    if not derivative.any():
        return NotTestable(piece.term.effect, "it changes nothing in these readings")
    return Candidate(piece.term, piece.names, piece.units, derivative, piece.typical)


def _without_trivial(form: Form, parts: list[FloatArray], held: FloatArray) -> FloatArray:
    remaining = [part for part in parts if not _is_held(part, held)] or parts[-1:]
    derivative = np.sum(remaining, axis=0)
    trivial = [each for each in form.trivial() if _is_held(each[:, None], held)]
    if not trivial:
        return np.asarray(derivative)
    space = span_of(np.stack(trivial, axis=1))
    for _ in range(2):
        derivative = derivative - space @ (space.T @ derivative)
    return np.asarray(derivative)


def _is_held(functions: FloatArray, held: FloatArray) -> bool:
    out = functions - held @ (held.T @ functions)
    return bool(np.linalg.norm(out) <= _HELD * np.linalg.norm(functions))


def _rms(values: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))
