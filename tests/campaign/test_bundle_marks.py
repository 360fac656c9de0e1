"""Runs that are kept but not trusted, and what is said about the others."""

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import import_bundle, import_report, read_bundle, write_bundle
from rigctl.campaign.status import status_in
from rigctl.campaign.store.store import Store


def marked(path, run_id):
    """The one run's record and what the report says of it."""
    recording = read_bundle(path)
    (record,) = (run for run in recording.runs() if run.run_id == run_id)
    return record, recording.report


def test_saturated_samples_make_a_run_invalid(sensing):
    for line, text in ((20, "10.0"), (21, "-10.5"), (22, "9.999")):
        sensing.set("runs/2.csv", line, "accel_v", text)
    record, report = marked(sensing.write(), "2")
    assert not record.valid
    assert record.reason == "accel_v: 2 of 400 samples saturated (full scale 10 V), first in line 20"
    assert report.invalid[0] == ("2", record.reason)
    assert report.warnings == ()


def test_missing_readings_of_the_sensor_make_a_run_invalid(sensing):
    for line, text in ((20, "nan"), (21, ""), (22, "NaN")):
        sensing.set("runs/2.csv", line, "accel_v", text)
    record, _ = marked(sensing.write(), "2")
    assert (record.valid, record.reason) == (False, "accel_v: 3 of 400 samples missing, first in line 20")


def test_a_run_that_no_fit_can_use_is_invalid(sensing, desk):
    # The stage did not move: what the sensor shows is no response to a drive.
    for line in range(2, 402):
        sensing.set("runs/2.csv", line, "stage_x_mm", "0.0")
    told = desk.rigctl("import", sensing.write(), "--store", desk.store, "--json").json
    assert list(told["not_reduced"]) == ["2"]
    assert told["invalid"]["2"] == told["not_reduced"]["2"]
    assert desk.rigctl("status", desk.store, "--json").json["runs_invalid"] == len(told["invalid"])
    with Store.open(desk.store, readonly=True) as store:
        run = store.run("2")
    assert (run.valid, run.reason) == (False, f"not reduced: {told['not_reduced']['2']}")


def test_gap_is_reported_and_never_filled(sensing):
    del sensing.tables["runs/2.csv"][101:111]
    recording = read_bundle(sensing.write())
    record = recording.runs()[1]
    assert not record.valid
    assert record.reason == "1 gap in t_s, about 10 samples, first after 0.99 s"
    assert recording.samples("2")["t_s"].size == 390


def test_uneven_time_base_is_reported_and_never_resampled(sensing):
    for line in range(2, 402):
        index = line - 2
        sensing.set("runs/2.csv", line, "t_s", repr(index * 0.01 + (0.002 if index == 50 else 0)))
    recording = read_bundle(sensing.write())
    assert recording.runs()[1].reason == "t_s is not equally spaced (median step 0.01 s), first at 0.49 s"
    assert recording.samples("2")["t_s"][50] == 0.502


def test_clock_that_changes_its_rate_is_reported(sensing):
    for line in range(2, 402):
        index = line - 2
        sensing.set("runs/2.csv", line, "t_s", repr(index * 0.01 + max(0, index - 200) * 2e-4))
    assert read_bundle(sensing.write()).runs()[1].reason.startswith("t_s is not equally spaced")


def test_times_rounded_to_what_a_spreadsheet_shows_are_even(sensing):
    for line in range(2, 402):
        sensing.set("runs/2.csv", line, "t_s", f"{(line - 2) / 96:.4f}")
    assert read_bundle(sensing.write()).runs()[1].valid


def test_run_given_up_by_its_recorder_may_be_short(sensing):
    sensing.set("runs.csv", 2, "valid", "0")
    sensing.tables["runs/1.csv"] = sensing.tables["runs/1.csv"][:11]
    recording = read_bundle(sensing.write())
    record = recording.runs()[0]
    short = "0.1 s is too short: one period takes 2 s"
    assert (record.valid, record.reason) == (False, f"marked invalid in runs.csv; {short}")
    assert recording.report.warnings == (f"{sensing.path / 'runs/1.csv'}: {short}",)


def test_reasons_do_not_pile_up_when_a_bundle_goes_round(sensing, tmp_path):
    sensing.set("runs/2.csv", 20, "accel_v", "11")
    first = read_bundle(sensing.write())
    write_bundle(first, tmp_path / "again")
    again = read_bundle(tmp_path / "again")
    assert [run.reason for run in again.runs()] == [run.reason for run in first.runs()]


def test_files_and_channels_nobody_asked_for_are_said(sensing):
    sensing.raw["runs/99.csv"] = b"t_s\n0\n"
    sensing.toml += '[channels.acel_v]\nunit = "V"\n[lasers.laser_9_mm]\nface = "z"\n'
    assert read_bundle(sensing.write()).report.warnings == (
        f"{sensing.path}/runs/99.csv: not in runs.csv, left out",
        f"{sensing.path}/recording.toml: [channels.acel_v] is a column of no run file",
        f"{sensing.path}/recording.toml: [lasers.laser_9_mm] is a column of no run file",
    )


def test_a_constant_that_no_result_reads_is_said(sensing):
    sensing.toml = sensing.toml.replace("[constants]", "[constants]\ng_ms2 = 9.81")
    (warning,) = read_bundle(sensing.write()).report.warnings
    assert warning == (
        f"{sensing.path}/recording.toml: [constants] g_ms2 is read by no result of this experiment; "
        "those read are g_m_s2, gain_v_per_m_s2"
    )


def test_number_spoilt_in_a_column_of_one_s_own_is_said(sensing):
    sensing.set("runs.csv", 3, "pressure_hpa", "n/a")
    recording = read_bundle(sensing.write())
    assert recording.runs()[0].conditions["pressure_hpa"] == "1013.2"
    assert recording.report.warnings == (
        f"{sensing.path}/runs.csv, line 3: 'n/a' makes column pressure_hpa one of text; leave a missing value empty",
    )


def test_platform_run_keeps_its_good_periods(platform):
    platform.set("runs/1.csv", 5, "q_a_v", "10.0")
    platform.set("runs/1.csv", 6, "q_b_v", "nan")
    platform.set("runs/1.csv", 150, "q_a_v", "12.0")
    assert platform.tables["runs/1.csv"][149][-1] == "1.0"
    record, report = marked(platform.write(), "1")
    assert record.valid
    remarks = (
        "q_b_v: 1 of 600 samples missing, first in line 6",
        "q_a_v: 1 of 600 samples saturated (full scale 10 V), first in line 5",
    )
    assert record.reason == "; ".join(remarks)
    assert report.warnings == tuple(f"{platform.path}/runs/1.csv: {remark}" for remark in remarks)


def test_columns_that_lose_the_same_samples_are_told_in_one_line(platform):
    for line in (5, 6):
        platform.set("runs/1.csv", line, "q_a_v", "nan")
        platform.set("runs/1.csv", line, "q_b_v", "nan")
    _, report = marked(platform.write(), "1")
    assert report.warnings == (
        f"{platform.path}/runs/1.csv: q_a_v, q_b_v: 2 of 600 samples missing, first in line 5",
    )
    platform.set("runs/1.csv", 9, "q_b_v", "nan")
    _, report = marked(platform.write(), "1")
    assert report.warnings == (
        f"{platform.path}/runs/1.csv: q_a_v: 2 of 600 samples missing, first in line 5",
        f"{platform.path}/runs/1.csv: q_b_v: 3 of 600 samples missing, first in line 5",
    )


def test_platform_run_without_one_reading_is_invalid(platform):
    for line in range(2, 602):
        platform.set("runs/4.csv", line, "q_b_v", "nan")
    record, _ = marked(platform.write(), "4")
    assert not record.valid
    assert "q_b_v: no sample has a value" in record.reason


def test_missing_scale_factor_and_wrong_rate_are_said(platform):
    platform.toml = platform.toml.replace("gain_q_b_v_per_m_s2 = 804.32\n", "")
    platform.set("runs.csv", 2, "sample_rate_hz", "100")
    recording = read_bundle(platform.write())
    assert recording.report.warnings == (
        f"{platform.path}/recording.toml: [constants] has no gain_q_b_v_per_m_s2; add it before you fit",
        f"{platform.path}/runs/1.csv: sample_rate_hz is 100, the samples have 10",
    )
    assert recording.runs()[0].valid


def test_store_remembers_what_its_import_found(sensing, tmp_path):
    sensing.set("runs/2.csv", 20, "accel_v", "11")
    sensing.raw["runs/99.csv"] = b"t_s\n0\n"
    expected = read_bundle(sensing.write()).report
    with import_bundle(sensing.path, tmp_path / "s.rig.sqlite") as store:
        assert import_report(store) == expected
        assert [run.valid for run in store.runs()] == [True, False, False]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["night", "s.rig.sqlite"]


def with_marks(readings, marks, reasons=None):
    """The table with a column `valid`, and one of reasons."""
    columns = {"valid": marks} | ({} if reasons is None else {"reason": reasons})
    table = readings.tables["readings.csv"]
    for name, fields in columns.items():
        table[0].append(name)
        for row, text in zip(table[1:], fields, strict=True):
            row.append(text)
    return readings


def test_rows_of_a_table_are_marked_as_runs_are_and_come_out_again(readings, tmp_path):
    marks = ["1", "0", "", "TRUE", "False", *["1"] * 7]
    with_marks(readings, marks, ["", "door", *[""] * 10])
    with import_bundle(readings.write(), tmp_path / "s.rig.sqlite") as store:
        report = import_report(store)
        write_bundle(store, tmp_path / "out")
        assert status_in(store)["readings_invalid"] == 2
    assert report.invalid == (("row 2", "door"), ("row 5", "marked invalid in readings.csv"))
    again = read_bundle(tmp_path / "out")
    assert again.report == report
    assert again.samples("readings")["valid"].tolist()[:2] == [1.0, 0.0]


@pytest.mark.parametrize("text", ["2", "yes", "0.5"])
def test_a_mark_of_a_row_that_is_none_is_refused(refusal, readings, text):
    with_marks(readings, ["1"] * 11 + [text])
    assert refusal(readings.write()) == (
        f"cell/readings.csv, line 13: valid is '{text}'; write 1 or 0, or give a column that says anything else "
        "another name"
    )


@pytest.mark.parametrize(("mark", "warnings"), [("1", 1), ("0", 0)])
def test_pasted_rows_are_told_of_unless_they_are_marked_invalid(readings, mark, warnings):
    values = np.random.default_rng(1).normal(size=200)
    rows = [f"{number},{value:.9f},{number},{number // 100},,1" for number, value in enumerate(values)]
    pasted = [row.removesuffix("1") + mark for row in rows[20:40]]
    readings.table("readings.csv", "load_lb,deflection_in,time_s,day,empty,valid", *rows, *pasted)
    assert len(read_bundle(readings.write()).report.warnings) == warnings


def test_a_row_of_a_table_is_marked_in_its_file(readings, desk):
    assert desk.rigctl("import", readings.write(), "--store", desk.store).status == 0
    said = "no run 3; the rows of a table are one run, readings; a row is left out by valid = 0 in readings.csv"
    desk.rigctl("mark", desk.store, "3", "--invalid", "slammed").refused(2, said)
