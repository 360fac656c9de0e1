"""What the bundles of the other experiments must hold: refused in one line that names file, line and mend."""

import pytest

from rigctl.campaign.bundle.bundle import import_bundle, read_bundle
from rigctl.core.errors import DataError

PLATFORM_FLAWS = [
    (2, "pattern", "d", "line 2: pattern is 'd'; write a, b, c, c_tm, custom, flip, scan or noise"),
    (
        2,
        "modulation_period_s",
        "",
        "line 2: pattern b has no modulation_period_s; write the period of its table",
    ),
    (
        3,
        "modulation_period_s",
        "50",
        "line 3: patterns.csv has no dwells of pattern custom with period_s 50; add them",
    ),
    (4, "g_sign", "", "line 4: a flip has no g_sign; write +1 or -1"),
    (2, "external", "square", "line 2: external is 'square'; write constant, sine or triangle"),
]


@pytest.mark.parametrize(("line", "column", "text", "message"), PLATFORM_FLAWS)
def test_flaw_in_a_platform_s_runs_is_refused(refusal, platform, line, column, text, message):
    platform.set("runs.csv", line, column, text)
    assert refusal(platform.write()) == f"platform/runs.csv, {message}"


def test_custom_pattern_needs_its_table(refusal, platform):
    del platform.tables["patterns.csv"]
    assert refusal(platform.write()) == (
        "platform/runs.csv, line 3: a custom pattern, but no patterns.csv; add it, one row per dwell"
    )


@pytest.mark.parametrize(
    ("column", "text", "message"),
    [
        ("sign_cos_theta", "0", "line 2: sign_cos_theta is 0; write +1 or -1"),
        ("stop_s", "61", "line 2: a dwell from 5 to 61 s does not lie in a period of 60 s; mend its times"),
        ("start_s", "soon", "line 2: start_s is 'soon'; write a number"),
        ("period_s", "", "line 2: period_s is missing; write it"),
    ],
)
def test_flaw_in_patterns_csv_is_refused(refusal, platform, column, text, message):
    platform.set("patterns.csv", 2, column, text)
    assert refusal(platform.write()) == f"platform/patterns.csv, {message}"


@pytest.mark.parametrize(
    ("bundle", "run_id", "column"),
    [
        ("platform", "1", "q_b_v"),
        ("platform", "1", "theta_deg"),
        ("platform", "2", "moving"),
        ("inflight", "a", "m2_z"),
        ("inflight", "b", "t_yz"),
        ("inflight", "b", "att_x"),
        ("inflight", "c", "command_y"),
    ],
)
def test_run_file_without_a_column_is_refused(request, refusal, bundle, run_id, column):
    bundle = request.getfixturevalue(bundle)
    bundle.set(f"runs/{run_id}.csv", 1, column, "other")
    assert f"runs/{run_id}.csv, line 1: column {column} is missing; " in refusal(bundle.write())


def test_platform_turning_half_is_refused(refusal, platform):
    platform.set("runs/1.csv", 9, "moving", "0.5")
    assert refusal(platform.write()) == "platform/runs/1.csv, line 9: moving is 0.5; write 1 or 0"


INFLIGHT_FLAWS = [
    (
        2,
        "session",
        "dq",
        "line 2: session is 'dq'; write dx, dz, dx+dz, dy, ac12, ac13, ad11, ad12, ad13, k2d, k2c_1, "
        "k2c_2, ep_inertial or ep_spin",
    ),
    (
        3,
        "calibration_frequency_hz",
        "",
        "line 3: session dy has no calibration_frequency_hz; write what was injected",
    ),
    (3, "amplitude", "", "line 3: session dy has no amplitude; write what was injected"),
    (
        3,
        "amplitude_unit",
        "m",
        "line 3: amplitude_unit m contradicts session dy; write rad and convert",
    ),
]


@pytest.mark.parametrize(("line", "column", "text", "message"), INFLIGHT_FLAWS)
def test_flaw_in_inflight_runs_is_refused(refusal, inflight, line, column, text, message):
    inflight.set("runs.csv", line, column, text)
    assert refusal(inflight.write()) == f"inflight/runs.csv, {message}"


def test_inflight_session_shorter_than_its_signal_is_refused(refusal, inflight):
    inflight.tables["runs/b.csv"] = inflight.tables["runs/b.csv"][:100]
    assert refusal(inflight.write()).startswith(
        "inflight/runs/b.csv: 495 s is too short: one period takes 815.069 s; record longer"
    )


TABLE_FLAWS = [
    ('response = "deflection_in"\n', "", "recording.toml, line 5: table has no response; add it"),
    ("baseline", "baselin", "recording.toml, line 7: table.baselin is unknown; the keys are "),
    ('"b0 + b1 * load_lb"', "3", "recording.toml, line 7: table.baseline is 3, not a text; put it in quotes"),
    ("b0 = 0.0", 'b0 = "0"', "recording.toml, line 8: table.start.b0 is '0', not a number; "),
    (
        '"deflection_in"',
        '"deflection_im"',
        "readings.csv, line 1: column deflection_im is missing, which [table] response names; rename deflection_in",
    ),
    (
        '"time_s"',
        '"when"',
        "readings.csv, line 1: column when is missing, which [table] order names; add it (there are ",
    ),
    (
        '"time_s"',
        '"day"',
        "readings.csv, line 2: column day holds 'Mon', but [table] order needs numbers; ",
    ),
]


@pytest.mark.parametrize(("was", "flaw", "message"), TABLE_FLAWS)
def test_flaw_in_a_table_recording_is_refused(refusal, readings, was, flaw, message):
    assert was in readings.toml
    readings.toml = readings.toml.replace(was, flaw, 1)
    assert refusal(readings.write()).startswith(f"cell/{message}")


def test_text_among_the_response_is_refused_with_its_line(refusal, readings):
    readings.set("readings.csv", 7, "deflection_in", "0,11".replace(",", "'"))
    assert refusal(readings.write()) == (
        'cell/readings.csv, line 7: column deflection_in holds "0\'11", but [table] response needs numbers; '
        "leave a missing value empty"
    )


@pytest.mark.parametrize(
    ("line", "text", "said"),
    [
        (9, "2024-02-30", "holds '2024-02-30', a day or time that does not exist; mend it"),
        (4, "7 May", "holds '7 May', no time stamp such as 2024-05-01T12:00:00Z; mend it"),
    ],
)
def test_a_time_stamp_that_is_none_is_refused_with_its_own_line(refusal, readings, line, text, said):
    for number in range(2, 14):
        readings.set("readings.csv", number, "time_s", f"2024-02-{8 + number}")
    readings.set("readings.csv", line, "time_s", text)
    assert refusal(readings.write()).startswith(f"cell/readings.csv, line {line}: column time_s {said}")


def test_a_time_stamp_that_is_none_is_told_where_nothing_needs_it(readings):
    readings.toml = readings.toml.replace('order = "time_s"\n', "")
    for number in range(2, 14):
        readings.set("readings.csv", number, "time_s", f"2024-02-{8 + number}")
    readings.set("readings.csv", 9, "time_s", "2024-02-30")
    (warning,) = read_bundle(readings.write()).report.warnings
    assert "readings.csv, line 9: '2024-02-30', a day or time that does not exist, makes column time_s one" in warning


def test_fields_between_tabs_are_named(refusal, readings):
    rows = readings.tables.pop("readings.csv")
    readings.raw["readings.csv"] = "".join("\t".join(row) + "\n" for row in rows).encode()
    assert refusal(readings.write()) == (
        "cell/readings.csv, line 1: fields are separated by tabs; save it with commas and decimal points"
    )


UNANSWERABLE = [
    ("b0 + b1 * load_lb", "b0 + * load_lb", "recording.toml, line 7: [table] baseline, character 6: "),
    (
        "b0 + b1 * load_lb",
        "b0 + sine(load_lb)",
        "recording.toml, line 7: [table] baseline, character 6: unknown func",
    ),
    ("b0 + b1 * load_lb", "b0 + b1 * deflection_in", "recording.toml, line 7: [table] baseline, character 11: def"),
    ("b0 + b1 * load_lb", "b0 + b1 + load_lb", "recording.toml, line 7: [table] baseline: the fit is singular: "),
    ("b1 = 1e-6", "b7 = 1e-6", "recording.toml, line 8: [table] start: b7 is no parameter of the baseline; "),
    ('block = "day"', 'block = "one"', "readings.csv: column one holds one value only, but [table] block needs two"),
    ('block = "day"', 'sigma = "load_lb"', "readings.csv, line 2: column load_lb holds 0, which is no standard unc"),
    (
        'block = "day"',
        "[table.constants.time_s]\nvalue = 1",
        "recording.toml, line 10: [table.constants]: time_s is a",
    ),
    (
        'block = "day"',
        "[table.constants.c]\nvalue = 1",
        "recording.toml, line 10: [table.constants]: c is not in the",
    ),
]


@pytest.mark.parametrize(("was", "flaw", "said"), UNANSWERABLE)
def test_a_table_that_no_command_could_use_is_refused_and_leaves_nothing(readings, tmp_path, was, flaw, said):
    assert was in readings.toml
    readings.toml = readings.toml.replace(was, flaw, 1)
    header, *rows = readings.tables["readings.csv"]
    readings.tables["readings.csv"] = [[*header, "one"], *([*row, "1"] for row in rows)]
    bundle = readings.write()
    before = sorted(tmp_path.iterdir())
    with pytest.raises(DataError) as refused:
        import_bundle(bundle, tmp_path / "s.rig.sqlite")
    assert str(refused.value).startswith(f"{bundle}/{said}")
    assert str(refused.value).isprintable()
    assert sorted(tmp_path.iterdir()) == before


def test_too_few_readings_for_the_parameters_are_refused(readings, tmp_path):
    readings.tables["readings.csv"] = readings.tables["readings.csv"][:3]
    readings.toml = readings.toml.replace('block = "day"\n', "")
    with pytest.raises(DataError, match=r"cell/readings\.csv: 2 usable readings for 2 parameters; add readings"):
        import_bundle(readings.write(), tmp_path / "s.rig.sqlite")


@pytest.mark.parametrize(("column", "text"), [("deflection_in", "inf"), ("load_lb", "1e400"), ("empty", "-1e308")])
def test_a_reading_nobody_can_have_measured_is_refused_with_its_line(refusal, readings, column, text):
    readings.set("readings.csv", 7, column, text)
    assert refusal(readings.write()) == (
        f"cell/readings.csv, line 7: column {column} holds {text}, which nobody can have measured; "
        "mend it, or leave a missing value empty"
    )


def test_table_without_readings_is_refused(refusal, readings):
    readings.tables["readings.csv"] = readings.tables["readings.csv"][:1]
    assert refusal(readings.write()) == "cell/readings.csv, line 1: no readings; add a row per reading"
