"""A table as a study: its readings, its catalogue, its models and starts, and what it refuses."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.campaign.recording import READINGS, ChannelInfo, Header, ImportReport, Recording, RunRecord
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.catalogue import Effect
from rigctl.effects.plugins import Plugin
from rigctl.experiments.table.model.model import TableModel, fitted
from rigctl.experiments.table.study import TableStudy, require_fit
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.verdict.fit import fit

X = np.linspace(0.0, 10.0, 40)
NOISE = np.random.default_rng(5).normal(size=40)


def _recording(
    columns: Mapping[str, Any],
    baseline: str = "b0 + b1 * x",
    channels: Mapping[str, ChannelInfo] | None = None,
    **spec: Any,
) -> Recording:
    numbers = {name: np.asarray(v, dtype=float) for name, v in columns.items() if not isinstance(v[0], str)}
    texts = {name: list(v) for name, v in columns.items() if isinstance(v[0], str)}
    header = Header(
        "table",
        channels=channels or {},
        extra={"table": {"response": "y", "baseline": baseline, "start": {}, **spec}},
    )
    record = RunRecord(READINGS, READINGS, "import", texts)
    return Recording(header, (record,), {READINGS: numbers}, ImportReport(1))


def _study(y: FloatArray, baseline: str = "b0 + b1 * x", **columns: Any) -> TableStudy:
    return TableStudy(_recording({"y": y, "x": X, **columns}, baseline))


def _values(model: TableModel) -> dict[str, float]:
    return {each.name: each.start for each in model.parameters}


def test_rows_are_runs_and_a_row_without_response_is_left_out() -> None:
    y = 1.0 + 2.0 * X
    y[3] = np.nan
    given = _study(y, temp_c=X**2).observations
    assert given.run_ids[:4] == ("row 1", "row 2", "row 3", "row 5")
    assert len(given.value) == 39
    assert set(given.covariates) == {"x", "temp_c"}
    assert given.pools[0].dof == 0.0
    assert given.pools[0].order is None
    assert given.series[0].channel == "y"


def test_readings_that_are_marked_invalid_are_in_nothing() -> None:
    y = 1.0 + 2.0 * X + 0.01 * NOISE
    valid, spoilt = np.ones(40), y.copy()
    valid[[4, 20]], valid[7], spoilt[[4, 20]] = 0.0, np.nan, 1e3
    sigma = np.where(valid == 0.0, 0.0, 0.01)
    recording = _recording({"y": spoilt, "x": X, "valid": valid, "u": sigma}, sigma="u")
    study = TableStudy(recording)
    given = study.observations
    assert len(given.value) == 38
    assert not {"row 5", "row 21"} & set(given.run_ids)
    assert dict(given.excluded) == dict.fromkeys(["row 5", "row 21"], "marked invalid in readings.csv")
    assert set(given.covariates) == {"x"}
    assert not any("valid" in effect for effect in study.effects())
    found = fit(study, [])
    assert found.excluded == given.excluded
    assert found.as_json()["excluded"] == dict(given.excluded)
    without = _study(y[valid != 0.0], x=X[valid != 0.0])
    assert found.parameters["b1"].value == pytest.approx(fit(without, []).parameters["b1"].value, rel=1e-9)
    assert "excluded" not in fit(without, []).as_json()
    assert diagnose(study, ()).as_json()["excluded"] == dict(given.excluded)


def test_rows_that_a_fit_leaves_out_are_named() -> None:
    y, x, note = 1.0 + 2.0 * X + 0.01 * NOISE, X.copy(), np.where(X[3] < X, X, np.nan)
    assert not require_fit(_recording({"y": y, "x": x, "note": note}))
    y[[4, 9]], x[9], x[20] = np.nan, np.nan, np.nan
    assert require_fit(_recording({"y": y, "x": x, "note": note})) == (
        "readings.csv: 3 rows are left out, which lack what the fit needs: row 5 has no y, row 10 has no y, x, row 21"
        " has no x",
    )


def test_no_reading_is_proposed_where_an_inverse_or_a_logarithm_ends() -> None:
    places = np.tile([10.0, 35.0, 60.0, 110.0], 10)
    for column, lowest in ((places, 10.0), (places - 10.0, 0.0), (places - 25.0, -35.0)):
        offered = [each.settings["x"] for each in _study(1.0 + column + 0.01 * NOISE, x=column).options()]
        assert min(offered) == lowest
        assert (0.0 in offered) == (0.0 in column)


@pytest.mark.parametrize(
    ("baseline", "spec", "marks", "where"),
    [
        ("b0 + b1*valid", {}, np.ones(40), "[table] baseline, character 9: "),
        ("b0 + b1*x", {"response": "valid"}, np.ones(40), "[table] response: "),
        ("b0 + b1*x", {"block": "valid"}, np.ones(40), "[table] block: "),
        ("b0 + b1*x", {"batch": ["valid"]}, np.ones(40), "[table] batch: "),
        ("b0 + b1*x", {}, X, "readings.csv: "),
        ("b0 + b1*x", {}, ["yes"] * 40, "readings.csv: "),
    ],
)
def test_a_column_of_marks_is_nothing_else(baseline: str, spec: dict[str, Any], marks: Any, where: str) -> None:
    with pytest.raises(DataError) as caught:
        TableStudy(_recording({"y": 1.0 + X, "x": X, "valid": marks}, baseline, **spec))
    assert f"{where}column valid says which readings count (1 or 0)" in str(caught.value)
    assert "give a column that says anything else another name" in str(caught.value)


def test_where_all_readings_are_marked_invalid_there_is_nothing_to_fit() -> None:
    with pytest.raises(DataError, match="no valid row has a response"):
        TableStudy(_recording({"y": 1.0 + X, "x": X, "valid": np.zeros(40)}))


def test_a_difference_of_columns_is_one_though_a_column_has_its_text_for_a_name() -> None:
    study = TableStudy(_recording({"y": 1.0 + NOISE, "x": X, "z": X**2, "x-z": X - X**2}, "b0 + b1 * (x-z)"))
    assert study.data.readings.expression.columns == ("x", "z")


def test_order_makes_stretches_and_block_its_own_blocks() -> None:
    shuffled = np.random.default_rng(6).permutation(40).astype(float)
    base = {"y": 1.0 + X + NOISE, "x": X, "time_s": shuffled, "day": ["Mon", "Tue"] * 20}
    ordered = TableStudy(_recording(base, order="time_s")).observations
    assert ordered.pools[0].order == "time_s"
    assert ordered.covariates["time_s"].tolist() == sorted(shuffled)
    assert (np.diff(ordered.block_of) >= 0).all()
    assert len(set(ordered.block_of.tolist())) == 6
    by_day = TableStudy(_recording(base, block="day")).observations
    assert by_day.block_of.tolist() == [0, 1] * 20
    assert len(set(TableStudy(_recording(base)).observations.block_of.tolist())) == 7


def test_units_come_from_channels_and_suffixes() -> None:
    recording = _recording(
        {"y": 1.0 + X, "x": X, "t_s": X**2, "load": X + 1.0},
        channels={"y": ChannelInfo("V"), "load": ChannelInfo("m/s2")},
        order="t_s",
    )
    study = TableStudy(recording)
    found, _ = study.candidates(study.model([]), np.array([1.0, 1.0]))
    units = {each.term.effect: each.units for each in found}
    assert units["linear[t_s]"] == ("V/s",)
    assert units["power2[t_s]"] == ("V/s2",)
    assert units["power2[load]"] == ("V/(m/s2)2",)
    assert units["inverse[load]"] == ("V (m/s2)",)
    assert units["drift"] == ("V/s",)
    assert units["power2[x]"] == ("",)


def test_linear_baselines_need_no_start() -> None:
    study = _study(3.0 - 2.0 * X + 0.5 * X**2, "b0 + b1*x + b2*x**2")
    assert _values(study.model([])) == pytest.approx({"b0": 3.0, "b1": -2.0, "b2": 0.5})


def test_curved_baselines_are_searched_for() -> None:
    study = _study(3.0 * (1.0 - np.exp(-0.7 * X)) + 1e-3 * NOISE, "a * (1 - exp(-k * x))")
    assert _values(study.model([])) == pytest.approx({"a": 3.0, "k": 0.7}, rel=1e-2)


TRUTHS: dict[str, tuple[FloatArray, dict[str, float]]] = {
    "linear[z]": (0.4 * X**2, {"linear[z]": 0.4}),
    "power2[x]": (0.3 * X**2, {"power2[x]": 0.3}),
    "power3[x]": (0.02 * X**3, {"power3[x]": 0.02}),
    "inverse[w]": (2.0 / (X + 1.0), {"inverse[w]": 2.0}),
    "interaction[x,z]": (0.01 * X**3, {"interaction[x,z]": 0.01}),
    "exponential[x]": (2.0 * np.exp(-0.8 * X), {"exponential[x]": 2.0, "exponential[x].rate": -0.8}),
    "periodic[x]": (
        0.3 * np.cos(2 * np.pi * X / 2.7) - 0.4 * np.sin(2 * np.pi * X / 2.7),
        {"periodic[x].period": 2.7, "periodic[x].cos": 0.3, "periodic[x].sin": -0.4},
    ),
    "step[x]": (0.8 * (X > 4.2), {"step[x]": 0.8}),
}


@pytest.mark.parametrize("effect", TRUTHS)
def test_an_effect_is_sized_as_it_was_made_and_its_derivative_ranks_it_first(effect: str) -> None:
    added, expected = TRUTHS[effect]
    study = _study(1.0 + 0.5 * X + added + 1e-6 * NOISE, z=X**2, w=X + 1.0)
    values = _values(study.model([Term(effect)]))
    assert {name: values[name] for name in expected} == pytest.approx(expected, rel=1e-3)
    model = study.model([])
    start = np.array([each.start for each in model.parameters])
    found, _ = study.candidates(model, start)
    left = study.observations.value - model.predict(start)
    share = {each.term.effect: 0.0 for each in found}
    for each in found:
        held = model.jacobian(start)
        free = each.derivative - held @ np.linalg.lstsq(held, each.derivative, rcond=None)[0]
        explained = free @ np.linalg.lstsq(free, left, rcond=None)[0]
        share[each.term.effect] = max(share[each.term.effect], explained @ explained / (left @ left))
    assert share[effect] > 0.95


@pytest.mark.parametrize("effect", TRUTHS)
def test_a_model_s_derivatives_are_those_of_its_values(effect: str) -> None:
    study = _study(2.0 * np.exp(-0.4 * X) + 0.5 * X + 0.1 * NOISE, "a * exp(k * x) + b1 * x", z=X**2, w=X + 1.0)
    model = study.model([Term(effect), Term("periodic[z]")])
    values = np.array([each.start for each in model.parameters])
    free = [i for i, each in enumerate(model.parameters) if not each.fixed]
    slopes = model.jacobian(values)
    for i in free:
        step = 1e-6 * max(abs(values[i]), 1e-3)
        up, down = values.copy(), values.copy()
        up[i] += step
        down[i] -= step
        expected = (model.predict(up) - model.predict(down)) / (2 * step)
        assert slopes[:, i] == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize(("centre", "span"), [(1985.0, 70.0), (1e6, 2.0), (0.0, 1e-9)])
def test_powers_of_columns_far_from_zero_are_told_from_lower_ones(centre: float, span: float) -> None:
    x = centre + span * (np.linspace(0.0, 1.0, 40) ** 1.5 - 0.5)
    study = TableStudy(_recording({"y": 1.0 + (x - centre) / span + NOISE, "x": x}))
    model = study.model([])
    values = np.array([each.start for each in model.parameters])
    derivative = {c.term.effect: c.derivative[:, 0] for c in study.candidates(model, values)[0]}
    u = (x - centre) / span
    line = np.stack([np.ones(40), u], axis=1)
    for name, power in (("power2[x]", 2), ("power3[x]", 3)):
        own = derivative[name] / np.linalg.norm(derivative[name])
        own = own - line @ np.linalg.lstsq(line, own, rcond=None)[0]
        assert np.linalg.norm(own) > 0.99
        wanted = np.stack([np.ones(40), *(u**k for k in range(1, power + 1))], axis=1)
        outside = own - wanted @ np.linalg.lstsq(wanted, own, rcond=None)[0]
        assert np.linalg.norm(outside) < 1e-6
    own = derivative["linear[x]"]
    assert np.linalg.norm(own - line @ np.linalg.lstsq(line, own, rcond=None)[0]) < 1e-9 * np.linalg.norm(own)


COLUMNS = {
    "even": X,
    "uneven": np.sort(np.random.default_rng(7).uniform(0.0, 10.0, 40)),
    "with a gap": np.concatenate([np.linspace(0, 4, 20), np.linspace(6, 10, 20)]),
    "years": 1950.0 + np.arange(40.0),
}


@pytest.mark.parametrize("kind", ["periodic[x]", "exponential[x]", "step[x]"])
@pytest.mark.parametrize("name", COLUMNS)
def test_between_grid_points_little_power_is_lost(name: str, kind: str) -> None:
    x = COLUMNS[name]
    study = TableStudy(_recording({"y": NOISE, "x": x}, "b0 + 0*x"))
    found = [c for c in study.candidates(study.model([]), np.zeros(1))[0] if c.term.effect == kind]
    key = {"periodic[x]": "period", "exponential[x]": "rate", "step[x]": "at"}[kind]
    chosen = sorted(found, key=lambda c: c.term.choice[key])
    assert len(chosen) < 1500
    for number, (one, other) in enumerate(pairwise(chosen)):
        a, b = one.term.choice[key], other.term.choice[key]
        if a * b < 0.0:
            continue
        between = {"periodic[x]": 2.0 / (1.0 / a + 1.0 / b), "exponential[x]": np.copysign(np.sqrt(a * b), a)}.get(
            kind, 0.5 * (a + b)
        )
        if kind == "periodic[x]":
            signal = np.cos(2 * np.pi * (x - x.mean()) / between + 0.4)
        elif kind == "exponential[x]":
            signal = np.exp(between * (x - (x.max() if between > 0 else x.min())))
        else:
            signal = (x > between).astype(float)
        beside = np.stack([np.ones(40), (x - x.mean()) * (kind == "exponential[x]")], axis=1)
        kept = max(_explained(each.derivative, signal, beside) for each in chosen[max(number - 2, 0) : number + 4])
        assert kept > 0.95, (a, b)


def _explained(columns: FloatArray, signal: FloatArray, beside: FloatArray) -> float:
    """Share of the signal's power in the columns, whatever is `beside` fitted to both."""
    free, left = (each - beside @ np.linalg.lstsq(beside, each, rcond=None)[0] for each in (columns, signal))
    part = free @ np.linalg.lstsq(free, left, rcond=None)[0]
    return float(part @ part / (left @ left))


def test_periods_are_not_sought_below_what_clusters_can_tell() -> None:
    clusters = np.repeat(np.arange(10.0) * 110.0, 3) + np.random.default_rng(8).uniform(0.0, 2.0, 30)
    study = TableStudy(_recording({"y": NOISE[:30], "x": clusters}))
    found, _ = study.candidates(study.model([]), np.zeros(2))
    periods = [c.term.choice["period"] for c in found if c.term.effect == "periodic[x]"]
    assert min(periods) > 1.9 * 110.0
    assert max(periods) == pytest.approx(2.0 * np.ptp(clusters))


def test_what_cannot_be_asked_is_said() -> None:
    gaps = X.copy()
    gaps[[4, 9]] = np.nan
    study = _study(1.0 + X + NOISE, constant=np.ones(40), gaps=gaps, two=np.arange(40) % 2.0)
    _, refused = study.candidates(study.model([]), np.array([1.0, 1.0]))
    reasons = {each.effect: each.reason for each in refused}
    assert reasons["linear[constant]"] == "constant is constant"
    assert reasons["power2[gaps]"] == "gaps has no value in row 5, row 10"
    assert reasons["inverse[x]"] == "x is zero in 1 readings"
    assert reasons["power2[two]"] == "two takes 2 different values, and 3 are needed"
    assert reasons["drift"].startswith("the readings are in no order")
    with pytest.raises(DataError, match="cannot be fitted: constant is constant"):
        study.model([Term("linear[constant]")])


def test_there_may_be_several_of_a_scanned_kind() -> None:
    y = 1.0 + X + np.sin(2 * np.pi * X / 1.3) + 0.5 * np.cos(2 * np.pi * X / 3.1)
    study = _study(y)
    model = study.model([Term("periodic[x]"), Term("periodic[x]#2")])
    result = fitted(model)
    assert result is not None
    periods = sorted([result.value("periodic[x].period"), result.value("periodic[x]#2.period")])
    assert periods == pytest.approx([1.3, 3.1], rel=1e-6)
    found, _ = study.candidates(model, result.values)
    new = [c.term.effect for c in found if "periodic" in c.term.effect and c.names[0].endswith(".cos")]
    assert set(new) == {"periodic[x]#3"}
    harmonics = {c.names for c in found if c.names[0].startswith("periodic[x].")}
    assert harmonics == {(f"periodic[x].cos{h}", f"periodic[x].sin{h}") for h in range(2, len(harmonics) + 2)}
    with pytest.raises(ConfigError, match="in the model already"):
        study.model([Term("step[x]"), Term("step[x]")])
    with pytest.raises(ConfigError, match="there can be one power2"):
        study.model([Term("power2[x]#2")])
    with pytest.raises(ConfigError, match="unknown effect 'power9"):
        study.model([Term("power9[x]")])


def _self_heating(run: Any, share: float) -> FloatArray:
    """The response heats its own sensor."""
    return np.asarray(share * run.signal**2 * run.column("x"))


def _plugin(*effects: Effect) -> Plugin:
    return Plugin(Path("own.py"), "", {each.id: each for each in effects})


def test_a_plugin_acts_on_what_the_baseline_predicts() -> None:
    effect = Effect(
        "self-heating", "response", {"share": "1/V"}, {"share": 1e-3}, "bench notes", "recording", _self_heating
    )
    y = 1.0 + 0.5 * X
    study = TableStudy(_recording({"y": y + 0.01 * y**2 * X, "x": X}), [_plugin(effect)])
    assert study.effects()["self-heating"] == "The response heats its own sensor."
    model = study.model([Term("self-heating")])
    result = fitted(model)
    assert result is not None
    assert result.value("self-heating.share") == pytest.approx(0.01, rel=1e-6)
    assert result.value("b1") == pytest.approx(0.5, rel=1e-6)
    candidate = next(
        c for c in study.candidates(study.model([]), np.array([1.0, 0.5]))[0] if c.term.effect == "self-heating"
    )
    assert candidate.derivative[:, 0] == pytest.approx(y**2 * X, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("names", [("cos",), ("cos", "sin")])
def test_only_what_is_periodic_has_an_amplitude(names: tuple[str, ...]) -> None:
    """Somebody's own effect may call its parameters cos and sin, or only one of them."""

    def wobble(run: Any, **sizes: FloatArray) -> FloatArray:
        """The table wobbles."""
        angle = run.column("x")
        return np.asarray(sum(size * getattr(np, name)(angle) for name, size in sizes.items()))

    effect = Effect(
        "wobble", "response", dict.fromkeys(names, "V"), dict.fromkeys(names, 1e-3), "", "recording", wobble
    )
    noise = 0.01 * np.random.default_rng(3).standard_normal(X.size)
    study = TableStudy(_recording({"y": 1.0 + 0.5 * X + 0.1 * np.cos(X) + noise, "x": X}), [_plugin(effect)])
    found = fit(study, [Term("wobble")])
    assert set(found.result) == set(found.parameters)
    wave = fit(study, [Term("periodic[x]", {"period": 2.0 * np.pi})])
    assert set(wave.parameters) - set(wave.result) == {"periodic[x].cos", "periodic[x].sin"}
    amplitude = wave.result["periodic[x].amplitude"]
    assert abs(amplitude["value"] - 0.1) < 4.0 * amplitude["sigma"]


def _past(where: float) -> Effect:
    def past(run: Any, size: FloatArray) -> FloatArray:
        """It gives way."""
        return np.asarray(size * (run.column("x") > where))

    return Effect(f"past-{where:g}", "response", {"size": "V"}, {"size": 1e-3}, "", "recording", past)


def test_a_plugin_that_does_nothing_here_or_fails_here_says_so() -> None:
    def broken(run: Any, size: FloatArray) -> FloatArray:
        """One per bench."""
        return np.asarray(size * np.ones(3)[run.column("x").astype(int)])

    effects = [
        _past(5.0),
        _past(50.0),
        Effect("broken", "response", {"size": "V"}, {"size": 1.0}, "", "recording", broken),
    ]
    study = TableStudy(_recording({"y": 1.0 + 0.5 * X, "x": X}), [_plugin(*effects)])
    found, refused = study.candidates(study.model([]), np.array([1.0, 0.5]))
    reasons = {each.effect: each.reason for each in refused}
    assert {"past-5"} == {each.term.effect for each in found} & {effect.id for effect in effects}
    assert reasons["past-50"] == "it changes nothing in these readings"
    assert "effect 'broken' fails, line " in reasons["broken"]
    assert "IndexError" in reasons["broken"]


@pytest.mark.parametrize(
    ("baseline", "spec", "message"),
    [
        ("b0 + b1*y", {}, "character 9: y is the response; it cannot stand on the right side too"),
        ("b0 + b1*day", {}, "character 9: column day holds text"),
        ("2 * x", {}, "no parameter to fit"),
        (
            "b0 + b1*load-kN",
            {},
            "character 9: column load-kN cannot be named: names in a baseline are letters, digits",
        ),
        (
            "b0 + b1*load kN",
            {},
            "character 9: column load kN cannot be named: names in a baseline are letters, digits",
        ),
        ("b0 + x", {"start": {"b7": 1.0}}, "start: b7 is no parameter of the baseline; its parameters are b0"),
        ("b0 + 0*b1*x", {}, "parameter b1 drops out"),
        ("b0 + log(-x)*b1", {}, "log of zero in row 1"),
        ("b0 + log(k*x - 5)", {"start": {"k": 1.0}}, "log of a negative number in row 1, row 2, row 3 and"),
        ("b0 + b1*x", {"block": "same"}, "column same holds one value only"),
        ("b0 + b1*x", {"sigma": "y"}, "[table] response: column y is named by its sigma too, and cannot be both"),
        ("b0 + b1*x", {"order": "y"}, "[table] response: column y is named by its order too"),
        ("b0 + b1*x", {"block": "y"}, "[table] response: column y is named by its block too"),
        ("b0 + b1*x", {"batch": ["y"]}, "[table] response: column y is named by its batch too"),
        ("b0 + b1*x", {"sigma": "same", "order": "same"}, "[table] sigma: column same is named by its order too"),
        ("b0 + b1*same*x", {"sigma": "same"}, "[table] sigma: column same is named by its baseline too"),
        ("b0 + b1*x", {"batch": ["x"]}, "[table] batch: column x is named by its baseline too"),
        (" + ".join(f"b{i}*x**{i}" for i in range(41)), {}, "40 usable readings for 41 parameters"),
    ],
)
def test_a_question_that_cannot_be_asked_is_refused_in_one_line(
    baseline: str, spec: dict[str, Any], message: str
) -> None:
    columns = {"y": 1.0 + X, "x": X, "day": ["Mon"] * 40, "same": np.ones(40), "load-kN": X, "load kN": X}
    with pytest.raises(DataError) as caught:
        TableStudy(_recording(columns, baseline, **spec))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("x", "y", "baseline", "message"),
    [
        (1.0, 1e308, "b0 + b1 * x", "readings.csv, row 2: column y holds 1e+308, which nobody can have measured; "),
        (np.inf, 1.0, "b0 + b1 * x", "readings.csv, row 2: column x holds inf, which nobody can have measured; "),
        (1.0, 0.0, "b0 + b1 * x", "readings.csv: column y is the same in every row; "),
        (
            1e39,
            1.0,
            "b0 + b1 * x**5",
            "the baseline's terms are too large or too small to be fitted to this response",
        ),
        (1.0, 1.0, "b0 + b1 * x" + " + x" * 4000, "character 10001: longer than 10000 characters"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_numbers_that_overflow_are_refused_in_one_line(x: float, y: float, baseline: str, message: str) -> None:
    steps = np.arange(1.0, 21.0)
    columns = {"x": np.where(steps == 2, x, steps), "y": np.where(steps == 2, y, np.sqrt(steps) if y else 0.0)}
    with pytest.raises(DataError, match=re.escape(message)):
        _study(columns.pop("y"), baseline, **columns).model(())
