"""Derivatives share what predictions beside one another have in common, and are those of predictions made alone."""

from __future__ import annotations

import numpy as np
import pytest

from rigctl.experiments.sensing_axis.model import model as models
from rigctl.experiments.sensing_axis.study import SensingAxisModel, SensingAxisStudy
from rigctl.workbench.study import Term
from tests.experiments.test_sensing_axis_study import recording

MODELS = [
    (),
    ("encoder-eccentricity", "roll-gravity", "resonance", "thermal-bias"),
    ("yaw", "null-drift", "quadratic", "gain-drift", "laser-nonlinearity"),
]


def model_of(names: tuple[str, ...]) -> SensingAxisModel:
    mountings = (("X", "pendulum", 1), ("Y", "flag", 1))
    return SensingAxisStudy(recording(mountings)).model([Term(name) for name in names])


def somewhere(model: SensingAxisModel) -> np.ndarray:
    """Values off every start and off zero."""
    steps = [parameter.step or 0.0 for parameter in model.parameters]
    return np.array([parameter.start for parameter in model.parameters]) + 3.0 * np.array(steps)


def by_differences(names: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """Each prediction by a model of its own, which has nothing from before."""
    columns = []
    for place, parameter in enumerate(model_of(names).parameters):
        assert parameter.step is not None
        above, below = values.copy(), values.copy()
        above[place] += parameter.step
        below[place] -= parameter.step
        columns.append((model_of(names).predict(above) - model_of(names).predict(below)) / (2.0 * parameter.step))
    return np.stack(columns, axis=1)


def assert_same(slopes: np.ndarray, expected: np.ndarray) -> None:
    # Differences of predictions of order one over steps of 1e-7 and more, each column by its largest.
    size = np.abs(expected).max(axis=0)
    assert size.all()
    np.testing.assert_allclose(slopes / size, expected / size, atol=1e-7)


@pytest.mark.parametrize("names", MODELS)
def test_derivatives_are_differences_of_predictions_made_alone(
    names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    values = somewhere(model_of(names))
    expected = by_differences(names, values)
    # One by one, and side by side.
    for together in (1, 10_000):
        monkeypatch.setattr(models, "_ROWS_TOGETHER", together)
        assert_same(model_of(names).jacobian(values), expected)


def test_it_does_not_matter_where_a_model_was_asked_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor which other model was, at the very same values."""
    monkeypatch.setattr(models, "_ROWS_TOGETHER", 1)
    study = SensingAxisStudy(recording((("X", "pendulum", 1), ("Y", "flag", 1))))
    model, other = (study.model([Term(name)]) for name in ("roll-gravity", "pitch-gravity"))
    values = somewhere(model)
    for asked in (1.001 * values, values, values):
        for each, name in ((model, "roll-gravity"), (other, "pitch-gravity")):
            alone = model_of((name,))
            assert np.array_equal(each.predict(asked), alone.predict(asked))
            assert np.array_equal(each.jacobian(asked), alone.jacobian(asked))
    assert np.array_equal(other.predict(1.001 * values), model_of(("pitch-gravity",)).predict(1.001 * values))


def test_candidates_are_derivatives_by_effects_of_no_size(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(models, "_ROWS_TOGETHER", 1)
    study = SensingAxisStudy(recording((("X", "pendulum", 1), ("Y", "flag", 1))))
    model = study.model([Term("resonance")])
    values = somewhere(model)
    found, _ = study.candidates(model, values)
    tried = {"roll-gravity", "thermal-gain", "time-skew"}
    assert tried <= {each.term.effect for each in found}
    for each in found:
        if each.term.effect not in tried:
            continue
        wider = study.model([Term("resonance"), each.term])
        by_name = dict(zip((parameter.name for parameter in model.parameters), values, strict=True))
        at = np.array([by_name.get(parameter.name, 0.0) for parameter in wider.parameters])
        own = [owner == each.term.effect for owner in wider.owners]
        assert_same(each.columns, wider.jacobian(at)[:, own])
