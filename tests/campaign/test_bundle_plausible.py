"""What cannot be true is refused where it stands; what looks like another unit is named so."""

import math

import numpy as np
import pytest

from rigctl.campaign.bundle.bundle import read_bundle

HEADER = [
    ("9.803", "-9.8", "line 7: constants.g_m_s2 is -9.8; write the local gravity, positive, in m/s2"),
    ("9.803", "0", "line 7: constants.g_m_s2 is 0; "),
    ("9.803", "9803.0", "line 7: constants.g_m_s2 is 9803; "),
    (
        "gain_v_per_m_s2 = 100",
        "gain_v_per_m_s2 = 0.0",
        "line 8: constants.gain_v_per_m_s2 is 0, which measures nothing; write the scale factor",
    ),
    (
        "gain_v_per_m_s2 = 100",
        "gain_v_per_m_s2 = nan",
        "line 8: constants.gain_v_per_m_s2 is no quantity; write a number, or leave it out",
    ),
    ("gain_v_per_m_s2 = 100", "gain_v_per_m_s2 = 1e400", "line 8: constants.gain_v_per_m_s2 is no quantity"),
    ("gain_v_per_m_s2 = 100", f"gain_v_per_m_s2 = 1{'0' * 400}", "line 8: constants.gain_v_per_m_s2 is no quantity"),
    ("noise_rms = 0.0004", "noise_rms = nan", "line 13: channels.accel_v.noise_rms is no quantity"),
    ("full_scale = 10.0", "full_scale = 0", "line 14: channels.accel_v.full_scale is not positive"),
    ("tilt_deg = 5.0", "tilt_deg = 90.0", "line 23: lasers.laser_1_mm.tilt_deg is 90, with which the beam misses"),
    ("2026-11-21T01:00:00Z", "0001-01-01T00:00:00+23:00", "line 4: started "),
]


@pytest.mark.parametrize(("was", "flaw", "message"), HEADER)
def test_a_header_that_cannot_be_true_is_refused(refusal, sensing, was, flaw, message):
    assert was in sensing.toml
    sensing.toml = sensing.toml.replace(was, flaw, 1)
    assert refusal(sensing.write()).startswith(f"night/recording.toml, {message}")


SET_POINTS = [
    ("theta_deg", "1e300", "theta_deg is '1e300'; write a number that can be measured, at most 1e+40"),
    ("theta_deg", "1e6", "theta_deg is '1e6'; write an angle in degrees, at most 36000"),
    ("frequency_hz", "0", "frequency_hz is '0'; write a number above 0"),
    ("temperature_c", "-274", "temperature_c is '-274'; write a temperature in degrees Celsius, -273.15 to 10000"),
    ("mounting", "1e30", "mounting is '1e30'; write a whole number"),
    ("pressure_hpa", "inf", "column pressure_hpa holds inf, which nobody can have measured; "),
]


@pytest.mark.parametrize(("column", "text", "message"), SET_POINTS)
def test_a_set_point_that_cannot_be_true_is_refused(refusal, sensing, column, text, message):
    sensing.set("runs.csv", 3, column, text)
    assert refusal(sensing.write()).startswith(f"night/runs.csv, line 3: {message}")


def test_gravity_found_nowhere_on_earth_is_remarked_on(sensing):
    sensing.toml = sensing.toml.replace("9.803", "1.62")
    assert read_bundle(sensing.write()).report.warnings == (
        f"{sensing.path}/recording.toml: [constants] g_m_s2 is 1.62, which is found nowhere on Earth (9.76 to 9.84); "
        "check it",
    )


def scaled(bundle, name, column, factor):
    table = bundle.tables[name]
    at = table[0].index(column)
    for row in table[1:]:
        row[at] = repr(float(row[at]) * factor)


SLIPS = [
    (
        "stage_x_mm",
        1e-3,
        "stage_x_mm swings by 0.004998, amplitude_mm is 5: one of them looks like m; write both in mm",
    ),
    ("stage_x_mm", 1e3, "stage_x_mm swings by 4998, amplitude_mm is 5: one of them looks like um; write both in mm"),
    ("t_s", 1e3, "the stage moves at 0.0005 Hz, frequency_hz is 0.5: t_s looks like ms; write it in seconds"),
    ("t_s", 1e6, "the stage moves at 5e-07 Hz, frequency_hz is 0.5: t_s looks like us; write it in seconds"),
]


@pytest.mark.parametrize(("column", "factor", "message"), SLIPS)
def test_a_column_in_another_unit_is_named(refusal, sensing, column, factor, message):
    scaled(sensing, "runs/1.csv", column, factor)
    assert refusal(sensing.write()) == f"night/runs/1.csv, line 1: {message}"


def test_a_stage_that_stands_still_or_swings_otherwise_is_no_slip(sensing):
    scaled(sensing, "runs/1.csv", "stage_x_mm", 2.0)
    scaled(sensing, "runs/2.csv", "stage_x_mm", 0.0)
    recording = read_bundle(sensing.write())
    assert recording.report.warnings == (f"{sensing.path}/runs/1.csv: amplitude_mm is 5, the stage shows 9.995",)
    assert [run.valid for run in recording.runs()] == [True, True, False]


def test_a_temperature_below_absolute_zero_makes_a_run_invalid(sensing):
    sensing.tables["runs/1.csv"][0][4] = "temperature_2_c"
    sensing.set("runs/1.csv", 9, "temperature_2_c", "-300")
    record = read_bundle(sensing.write()).runs()[0]
    assert (record.valid, record.reason) == (False, "temperature_2_c: -300 in line 9 can be no reading in degC")


def test_the_platform_s_and_the_satellite_s_time_is_held_against_what_was_asked(refusal, platform, inflight):
    scaled(platform, "runs/1.csv", "t_s", 1e3)
    assert refusal(platform.write()) == (
        "platform/runs/1.csv, line 1: samples are 100 apart, sample_rate_hz is 10: "
        "t_s looks like ms; write it in seconds"
    )
    scaled(inflight, "runs/a.csv", "t_s", 1e3)
    assert refusal(inflight.write()) == (
        "inflight/runs/a.csv, line 1: samples are 5000 apart, sample_period_s is 5: "
        "t_s looks like ms; write it in seconds"
    )


def test_the_platform_s_pattern_is_held_against_its_time(refusal, platform):
    platform.set("runs.csv", 2, "sample_rate_hz", "")
    scaled(platform, "runs/1.csv", "t_s", 1e3)
    assert refusal(platform.write()).startswith(
        "platform/runs/1.csv, line 1: the platform turns 1 times in 998.3 periods of 60 s: t_s or modulation_period_s"
    )


def test_a_whole_recording_in_milliseconds_is_seen_by_its_orbits(refusal, inflight):
    inflight.set("runs.csv", 2, "sample_period_s", "")
    t_s = np.arange(500) * 119_000.0
    inflight.columns(
        "runs/a.csv", **{name: t_s if name == "t_s" else np.ones(500) for name in inflight.tables["runs/a.csv"][0]}
    )
    assert "it lasts 5.95e+07, its orbits take 5.95e+04 s: t_s looks like ms" in refusal(inflight.write())
    assert math.isclose(t_s[-1] + t_s[1], 59_500e3)


@pytest.mark.parametrize(
    ("name", "flaw", "message"),
    [
        (
            "orbit_period_s = 5950.0",
            "orbit_period_s = 99.2",
            "line 5: constants.orbit_period_s is 99.2, shorter than",
        ),
        ("eccentricity = 5e-3", "eccentricity = 1.0", "line 6: constants.eccentricity is 1, that of no orbit; "),
    ],
)
def test_an_orbit_that_cannot_be_is_refused(refusal, inflight, name, flaw, message):
    inflight.toml = inflight.toml.replace(name, flaw)
    assert refusal(inflight.write()).startswith(f"inflight/recording.toml, {message}")
