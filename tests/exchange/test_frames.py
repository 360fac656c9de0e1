"""Runs and samples as frames and datasets: every number, with its unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rigctl import Campaign
from rigctl.campaign.recording import ChannelInfo, Header, ImportReport, Recording, RunRecord
from rigctl.core.errors import DataError
from rigctl.exchange.frames import run_dataset, runs_frame

T_S, VOLTS = np.arange(5.0) / 10.0, np.array([0.1, 0.2, np.nan, 0.4, 0.5])
HEADER = Header(
    experiment="table", title="two runs", channels={"accel_v": ChannelInfo(unit="V", kind="accelerometer")}
)
RUNS = [
    RunRecord("1", "first", "", {"theta_deg": 0.5, "axis": "X"}, True, "", "finished"),
    RunRecord("2", "second", "", {"theta_deg": -0.5, "axis": "X"}, False, "a door", "finished"),
]
COLUMNS = {"1": {"t_s": T_S, "accel_v": VOLTS, "stage_x_mm": T_S[:4]}, "2": {"t_s": T_S, "accel_v": VOLTS}}


@pytest.fixture
def recording() -> Recording:
    return Recording(HEADER, RUNS, COLUMNS, ImportReport(2))


def test_runs_are_rows_with_their_conditions(recording: Recording) -> None:
    frame = runs_frame(recording)
    assert frame.index.name == "run_id"
    assert frame.loc["2"].to_dict() == {"theta_deg": -0.5, "axis": "X", "valid": False, "reason": "a door"}
    assert frame[frame.valid].theta_deg.tolist() == [0.5]


def test_samples_are_variables_along_their_time(recording: Recording) -> None:
    dataset = run_dataset(recording, "2")
    np.testing.assert_array_equal(dataset.accel_v, VOLTS)
    np.testing.assert_array_equal(dataset.t_s, T_S)
    assert dataset.accel_v.attrs == {"units": "V", "long_name": "accel", "kind": "accelerometer"}
    assert (dataset.attrs["theta_deg"], dataset.attrs["run_id"], dataset.attrs["valid"]) == (-0.5, "2", 0)


def test_columns_of_an_interrupted_run_end_together(recording: Recording) -> None:
    dataset = run_dataset(recording, "1")
    assert dict(dataset.sizes) == {"t_s": 4}
    assert dataset.stage_x_mm.attrs["units"] == "mm"


def test_a_run_that_is_not_there_is_one_line(recording: Recording) -> None:
    with pytest.raises(DataError, match="no run '7' in this recording"):
        run_dataset(recording, "7")


def test_a_shipped_recording_as_a_notebook_takes_it(tmp_path: Path) -> None:
    """Ten lines: import, runs, a fit's uncertain numbers with their correlation."""
    import uncertainties

    from rigctl.campaign.bundle.bundle import import_bundle
    from rigctl.exchange.uncertain_numbers import as_uncertainties

    store = tmp_path / "cell.rig.sqlite"
    import_bundle(Path("examples/pontius"), store).close()
    Campaign.add(store, "power2[load_lb]")
    fit, numbers = Campaign.fit(store), as_uncertainties(Campaign.measured(store))
    for name, number in numbers.items():
        assert number.nominal_value == pytest.approx(fit.parameters[name].value, rel=1e-9)
        assert number.std_dev == pytest.approx(fit.parameters[name].sigma, rel=1e-9)
    correlation = np.array(uncertainties.correlation_matrix(list(numbers.values())))
    assert correlation[0, 1] < -0.5  # a constant and a slope
    readings = Campaign.samples(store, "readings").to_dataframe()
    assert readings.shape == (40, 2)
    assert readings.deflection_in[0] == 0.11019


def test_words_of_a_table_are_a_column_too(recording: Recording) -> None:
    run = RunRecord("readings", "", "", {"state": ["new", "old"], "room": "A"}, True, "", "finished")
    table = Recording(
        Header(experiment="table"), [run], {"readings": {"rate": np.array([1.0, 2.0])}}, ImportReport(1)
    )
    frame = run_dataset(table, "readings").to_dataframe()
    assert frame.groupby("state").rate.sum().to_dict() == {"new": 1.0, "old": 2.0}
    assert runs_frame(table).columns.tolist() == ["room", "valid", "reason"]
