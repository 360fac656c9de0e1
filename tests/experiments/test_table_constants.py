"""Constants of a table's baseline: what their uncertainty does to a fit is what GTC works out by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import GTC
import numpy as np
import pytest
import uncertainties

from rigctl import Campaign
from rigctl.campaign.bundle.bundle import import_bundle, read_bundle, write_bundle
from rigctl.campaign.table_constants import TableConstant
from rigctl.core.arrays import FloatArray
from rigctl.core.errors import ConfigError, DataError, ProcedureError
from rigctl.exchange.uncertain_numbers import as_constants, as_gtc

LOAD = np.linspace(1.0, 9.0, 30)
TEMPERATURE = 20.0 + 5.0 * np.sin(1.3 * LOAD)
# So large that a sensitivity at perfect agreement would be another one.
NOISE = 2.0 * np.random.default_rng(3).normal(size=30)
BASELINE = "b0 + b1 * load * (1 + alpha * (temp_c - t0_c))"
RESPONSE = 0.5 + 2.0 * LOAD * (1.0 + 0.004 * (TEMPERATURE - 20.0)) + NOISE
FILE = {
    "alpha": TableConstant(0.004, 0.003, 8.0, {"t0_c": -0.6}),
    "t0_c": TableConstant(20.0, 12.0, 8.0),
}


def _bundle(directory: Path, constants: str = "", baseline: str = BASELINE) -> Path:
    directory.mkdir()
    head = f'format = 1\nexperiment = "table"\n[table]\nresponse = "y"\nbaseline = "{baseline}"\n'
    (directory / "recording.toml").write_text(head + constants)
    rows = zip(RESPONSE, LOAD, TEMPERATURE, strict=True)
    lines = [",".join(repr(float(number)) for number in row) for row in rows]
    (directory / "readings.csv").write_text("\n".join(["y,load,temp_c", *lines]) + "\n")
    return directory


def _line(x: Any, y: FloatArray) -> tuple[Any, Any]:
    """Intercept and slope by the closed form of least squares, in whatever arithmetic `x` brings."""
    mean = sum(x) / len(x)
    slope = sum((one - mean) * float(other - y.mean()) for one, other in zip(x, y, strict=True)) / sum(
        (one - mean) * (one - mean) for one in x
    )
    return float(y.mean()) - slope * mean, slope


def _by_gtc() -> tuple[dict[str, Any], tuple[Any, Any]]:
    """The constants as GTC has them, and intercept and slope as it propagates these."""
    alpha, t0 = GTC.multiple_ureal([0.004, 20.0], [0.003, 12.0], 8.0, ["alpha", "t0"])
    GTC.set_correlation(-0.6, alpha, t0)
    effective = [
        float(load) * (1.0 + alpha * (float(temp) - t0)) for load, temp in zip(LOAD, TEMPERATURE, strict=True)
    ]
    return {"alpha": alpha, "t0_c": t0}, _line(effective, RESPONSE)


def test_a_fit_with_correlated_constants_is_as_uncertain_as_gtc_says(tmp_path: Path) -> None:
    constants, by_hand = _by_gtc()
    assert as_constants(constants) == FILE
    store = tmp_path / "t.rig.sqlite"
    import_bundle(_bundle(tmp_path / "table"), store, constants=as_constants(constants)).close()
    measured = Campaign.measured(store)
    noise, given = measured.sources
    assert (given.name, given.type, given.in_common) == ("alpha, t0_c", "B", True)
    assert measured.values == pytest.approx([GTC.value(each) for each in by_hand], rel=1e-9)
    assert given.standard_uncertainty == pytest.approx([GTC.uncertainty(each) for each in by_hand], rel=1e-4)
    correlation = given.covariance[0, 1] / np.prod(given.standard_uncertainty)
    assert correlation == pytest.approx(GTC.get_correlation(*by_hand), rel=1e-4)

    # The noise is another independent input, and the two add up as GTC adds them.
    of_noise = [GTC.ureal(0.0, float(u), noise.dof) for u in noise.standard_uncertainty]
    for number, mine in zip(by_hand, of_noise, strict=True):
        name = "b0" if number is by_hand[0] else "b1"
        together = number + mine
        assert GTC.uncertainty(as_gtc(measured)[name]) == pytest.approx(GTC.uncertainty(together), rel=1e-4)
        assert GTC.dof(as_gtc(measured)[name]) == pytest.approx(GTC.dof(together), rel=1e-3)
        assert Campaign.fit(store).parameters[name].sigma == pytest.approx(GTC.uncertainty(together), rel=1e-4)


def test_without_their_correlation_it_is_another_uncertainty(tmp_path: Path) -> None:
    uncorrelated = {name: TableConstant(each.value, each.u, each.dof) for name, each in FILE.items()}
    store = tmp_path / "t.rig.sqlite"
    import_bundle(_bundle(tmp_path / "table"), store, constants=uncorrelated).close()
    _, alpha, t0 = Campaign.measured(store).sources
    assert (alpha.name, t0.name, alpha.input) == ("alpha", "t0_c", "0.003")
    _, (_, slope) = _by_gtc()
    assert np.hypot(alpha.standard_uncertainty[1], t0.standard_uncertainty[1]) != pytest.approx(slope.u, rel=0.1)


def test_a_file_states_the_same_and_an_export_states_it_again(tmp_path: Path) -> None:
    stated = """[table.constants.alpha]\nvalue = 0.004\nu = 0.003\ndof = 8\ncorrelation = { t0_c = -0.6 }
[table.constants.t0_c]\nvalue = 20.0\nu = 12.0\ndof = 8\n"""
    with import_bundle(_bundle(tmp_path / "table", stated), tmp_path / "t.rig.sqlite") as store:
        write_bundle(store, tmp_path / "again")
    for directory in ("table", "again"):
        spec = read_bundle(tmp_path / directory).header.table
        assert spec is not None
        assert spec.constants == FILE


def test_a_certain_constant_is_a_number_in_the_baseline(tmp_path: Path) -> None:
    named, written = tmp_path / "named.rig.sqlite", tmp_path / "written.rig.sqlite"
    baseline = "b0 + b1 * load ** power"
    import_bundle(_bundle(tmp_path / "one", baseline=baseline), named, constants=as_constants({"power": -2})).close()
    import_bundle(_bundle(tmp_path / "other", baseline=baseline.replace("power", "(-2)")), written).close()
    assert Campaign.fit(named).parameters == Campaign.fit(written).parameters


@pytest.mark.parametrize(
    ("constants", "said"),
    [
        ("k = 3.0", "recording.toml, line 7: table.constants.k is 3.0; make it a table [table.constants.k]"),
        ("alpha = { u = 1.0 }", "line 7: table.constants.alpha has no value; add it"),
        ("alpha = { value = 1, sigma = 1 }", "sigma is unknown; the keys are value, u, dof, correlation"),
        ("alpha = { value = 1, u = -1 }", "alpha.u is no standard uncertainty; write a positive one"),
        ("alpha = { value = 1, dof = 0.5 }", "alpha.dof is less than 1; write the degrees of freedom"),
        ("alpha = { value = 1, correlation = { b1 = 0.1 } }", "alpha.correlation.b1 is with no other constant"),
        (
            "alpha = { value = 1, correlation = { t0_c = 1.1 } }\nt0_c = { value = 1 }",
            "alpha.correlation.t0_c is no correlation coefficient; write a number from -1 to 1",
        ),
        (
            "alpha = { value = 1, correlation = { t0_c = 0.1 } }\nt0_c.value = 1\nt0_c.correlation.alpha = 0.2",
            "alpha.correlation.t0_c is another number for t0_c with alpha; state it once",
        ),
        (
            "alpha = { value = 1, correlation = { t0_c = 0.9, b0 = 0.9 } }\n"
            "t0_c = { value = 1, correlation = { b0 = -0.9 } }\nb0 = { value = 1 }",
            "table.constants have correlations that no quantities can have together; mend one of them",
        ),
    ],
)
def test_a_constant_that_cannot_be_is_refused_with_its_line(tmp_path: Path, constants: str, said: str) -> None:
    bundle = _bundle(tmp_path / "table", f"[table.constants]\n{constants}\n")
    with pytest.raises(DataError) as refused:
        read_bundle(bundle)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("load", "[table.constants]: load is a column of readings.csv; give the constant another name"),
        ("pi", "[table.constants]: pi has its value already; give the constant another name"),
        ("gamma", "[table.constants]: gamma is not in the baseline; write it there, or leave it out"),
    ],
)
def test_a_constant_that_the_baseline_has_not_is_refused(tmp_path: Path, name: str, said: str) -> None:
    store = tmp_path / "t.rig.sqlite"
    with pytest.raises(DataError) as refused:
        import_bundle(_bundle(tmp_path / "table"), store, constants={**FILE, name: TableConstant(1.0)})
    assert said in str(refused.value)
    assert not store.exists()


def test_constants_that_leave_no_fit_are_named(tmp_path: Path) -> None:
    """A tenth of u away the logarithm has no value."""
    store = tmp_path / "t.rig.sqlite"
    baseline = "b0 + b1 * log(load - first)"
    constants = {"first": TableConstant(0.99, 0.5)}
    import_bundle(_bundle(tmp_path / "table", baseline=baseline), store, constants=constants).close()
    with pytest.raises(ProcedureError, match=r"first 0\.05 beside its value 0\.99") as refused:
        Campaign.fit(store)
    assert "\n" not in str(refused.value)


def test_other_recordings_have_no_constants(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="frequency-response recording has no baseline"):
        read_bundle(_bundle(tmp_path / "table")).header.__class__("frequency-response").with_constants(FILE)
    with pytest.raises(DataError, match=r"constants\.alpha\.u is no standard uncertainty"):
        read_bundle(tmp_path / "table").header.with_constants({"alpha": TableConstant(1.0, float("nan"))})


def test_numbers_of_uncertainties_bring_their_correlations() -> None:
    length = uncertainties.ufloat(2.0, 0.1)
    area, ratio = length * uncertainties.ufloat(3.0, 0.3), length / 2.0
    found = as_constants({"area": area, "ratio": ratio, "count": 7})
    assert found["count"] == TableConstant(7.0)
    assert (found["area"].value, found["area"].u) == (area.nominal_value, area.std_dev)
    # 3 * 0.1 of the area's uncertainty is of the length, which is all of the ratio's.
    assert found["area"].correlation == {"ratio": pytest.approx(3.0 * 0.1 / area.std_dev)}
    assert found["ratio"].correlation == {}


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"a": "1.0 +- 0.1"}, "'1.0 \\+- 0.1' is no uncertain number; give a number"),
        ({"a": uncertainties.ufloat(1, 0.1), "b": GTC.ureal(1, 0.1)}, "of GTC and uncertainties together"),
        ({"z": GTC.ucomplex(1 + 1j, 0.1)}, "z is complex; give its real and imaginary parts"),
    ],
)
def test_what_is_no_real_uncertain_number_is_refused(numbers: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        as_constants(numbers)
