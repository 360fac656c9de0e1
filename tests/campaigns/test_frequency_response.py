"""The frequency response over the wire: what comes out beside what nature was told, and what the workbench names."""

from __future__ import annotations

import cmath
import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl import runner
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.core.errors import ConfigError, LimitError
from rigctl.experiments.analysis import analysis_of
from rigctl.files.campaign_file import parse_campaign
from rigctl.files.rig_file import parse_rig
from rigctl.workbench.study import Term
from rigctl.workbench.verdict.attempt import Attempt

F0_HZ, Q, GAIN = 42.0, 0.8, 1.25
SHORT = {
    "frequencies_hz = [0.5, 0.8, 1.25, 2.0, 3.15, 5.0, 8.0, 12.5, 20.0]": "frequencies_hz = [1.25, 3.15, 8.0, 20.0]",
    "accelerations_m_s2 = [0.2, 1.0, 4.0]": "accelerations_m_s2 = [0.5, 1.0]",
    "dwell_s = 20.0": "dwell_s = 7.0",
}
LATE = {"frequency_hz = 42.0\n": "late_s = 0.0003\n"}
FLAT = {"frequency_hz = 42.0\n": "frequency_hz = 0.0\n"}

Made = Callable[..., Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The shipped campaign, shortened, on its rig with another nature; each nature once."""
    known: dict[str, Path] = {}

    def run(nature: dict[str, str] | None = None) -> Path:
        if (name := repr(nature)) not in known:
            campaign, rig = files(SHORT, nature or {})
            store = tmp_path_factory.mktemp("response") / "x.rig.sqlite"
            runner.start(parse_campaign(campaign, Path("c.toml")), parse_rig(rig, Path("r.toml")), store, UNATTENDED)
            known[name] = store
        return known[name]

    return run


UNATTENDED = runner.Options(unattended=True)
CAMPAIGNS = Path(__file__).parents[2] / "campaigns"


def files(of_campaign: dict[str, str], of_rig: dict[str, str]) -> tuple[str, str]:
    """Both files, with something in them replaced."""
    texts = []
    for name, changes in (("frequency-response", of_campaign), ("frequency-response-rig", of_rig)):
        text = (CAMPAIGNS / f"{name}.toml").read_text()
        for old, new in changes.items():
            assert old in text, old
            text = text.replace(old, new)
        texts.append(text)
    return texts[0], texts[1]


def result_of(path: Path) -> dict[str, Any]:
    with Store.open(path) as store:
        return analysis_of("frequency-response").result(workbench_of(store))


def diagnosis_of(path: Path) -> dict[str, Any]:
    with Store.open(path) as store:
        return workbench_of(store).diagnose().as_json()


def transfer(frequency_hz: float) -> complex:
    """Of the spring of the shipped nature, with its gain."""
    r = frequency_hz / F0_HZ
    return GAIN / (1.0 - r * r + 1j * r / Q)


def test_the_sensitivity_is_natures_within_its_noise(made: Made) -> None:
    found = result_of(made())["sensitivity"]
    assert [each["frequency_hz"] for each in found] == [1.25, 3.15, 8.0, 20.0]
    pulls = []
    for each in found:
        truth, noise = transfer(each["frequency_hz"]), each["budget"]
        pulls.append((each["magnitude"]["value"] - abs(truth)) / noise["noise of the magnitude"]["magnitude"])
        off_deg = each["phase_deg"]["value"] - math.degrees(cmath.phase(truth))
        pulls.append(off_deg / noise["noise of the phase"]["phase_deg"])
        assert each["runs"] == 4
    # Eight pulls: 99.9 % of chi-squared with eight degrees of freedom.
    assert np.sum(np.square(pulls)) < 26.1


def test_the_budget_has_what_certificates_say(made: Made) -> None:
    found = result_of(made())
    at_8_hz = found["sensitivity"][2]
    size = at_8_hz["magnitude"]["value"]
    # Of each head scale and tan(5 deg) times 0.05 deg; the mean of two.
    head = math.hypot(3e-4, math.tan(math.radians(5.0)) * math.radians(0.05))
    assert at_8_hz["budget"]["reference"]["magnitude"] == pytest.approx(size * head / math.sqrt(2.0), rel=1e-3)
    assert at_8_hz["budget"]["voltmeter"]["magnitude"] == pytest.approx(size * 3e-5, rel=1e-3)
    assert at_8_hz["budget"]["clock"]["magnitude"] == pytest.approx(size * 2e-6, rel=1e-3)
    # Accelerometer 1e-4 s; 5e-5 s of both heads, which are triggered together.
    delay_s = math.hypot(1e-4, 5e-5)
    assert at_8_hz["budget"]["delay"]["phase_deg"] == pytest.approx(360.0 * 8.0 * delay_s, rel=1e-3)
    parts = [part["magnitude"] for part in at_8_hz["budget"].values()]
    assert at_8_hz["magnitude"]["u"] == pytest.approx(math.hypot(*parts))
    assert at_8_hz["magnitude"]["U"] == pytest.approx(at_8_hz["magnitude"]["k"] * at_8_hz["magnitude"]["u"])
    covariance = np.array(found["covariance"]["magnitude"])
    assert np.sqrt(covariance[2, 2]) == pytest.approx(at_8_hz["magnitude"]["u"])
    # Nearly all of it is common to all frequencies.
    assert covariance[2, 3] / np.sqrt(covariance[2, 2] * covariance[3, 3]) > 0.99


def test_the_workbench_names_the_resonance_with_its_size(made: Made) -> None:
    found = diagnosis_of(made())
    assert (found["verdict"], found["suggested"]) == ("effect", ["resonance"])
    told = found["joint_fit"]["parameters"]
    w0 = 2.0 * math.pi * F0_HZ
    for name, truth in (("inv_w0_squared", w0**-2.0), ("damping", 1.0 / (w0 * Q))):
        assert abs(told[name]["value"] - truth) < 4.0 * told[name]["sigma"]


def test_a_flat_response_is_adequate_and_linear(made: Made) -> None:
    path = made(FLAT)
    assert diagnosis_of(path)["verdict"] == "adequate"
    found = result_of(path)
    assert abs(found["linearity"]["kappa"]["value"]) < 4.0 * found["linearity"]["kappa"]["sigma"]
    assert abs(found["direction_asymmetry"]["value"]) < 4.0 * found["direction_asymmetry"]["sigma"]


def test_a_pole_is_named_a_lag_with_its_time_constant(made: Made) -> None:
    found = diagnosis_of(made({"frequency_hz = 42.0\n": "lag_s = 0.003\n"}))
    assert (found["verdict"], found["suggested"]) == ("effect", ["lag"])
    tau = found["joint_fit"]["parameters"]["tau"]
    assert abs(tau["value"] - 0.003) < 4.0 * tau["sigma"]


def test_recorders_that_differ_are_named_a_skew_beside_what_bends_the_response(made: Made) -> None:
    found = diagnosis_of(made({"frequency_hz = 42.0\n": "late_s = 0.0003\ncubic_s4_m2 = 4e-3\n"}))
    assert (found["verdict"], set(found["suggested"])) == ("effect", {"time-skew", "cubic"})
    told = found["joint_fit"]["parameters"]
    for name, truth in (("tau", 3e-4), ("K3", 4e-3)):
        assert abs(told[name]["value"] - truth) < 4.0 * told[name]["sigma"]


def test_a_bent_response_shows_in_the_linearity_and_directions_that_differ_as_such(made: Made) -> None:
    bent = "frequency_hz = 0.0\ncubic_s4_m2 = 4e-3\nasymmetry = 3e-4\n"
    path = made({"frequency_hz = 42.0\n": bent})
    found = result_of(path)
    kappa, both = found["linearity"]["kappa"], found["direction_asymmetry"]
    # The fundamental of a^3 is three quarters of it; the harmonic means of the directions leave second orders.
    assert abs(kappa["value"] - 0.75 * 4e-3) < 4.0 * kappa["sigma"] + 1e-2 * kappa["value"]
    assert abs(both["value"] - 3e-4) < 4.0 * both["sigma"] + 1e-3 * 3e-4
    assert set(diagnosis_of(path)["suggested"]) == {"cubic", "direction-asymmetry"}


def test_a_bundle_of_it_in_another_order_gives_the_same_numbers(made: Made, desk: Any, tmp_path: Path) -> None:
    path = made()
    assert desk.rigctl("export", path, "bundle").status == 0
    rows = desk.directory / "bundle" / "runs.csv"
    head, *runs = rows.read_text().splitlines()
    rows.write_text("\n".join([head, *reversed(runs)]) + "\n")
    assert desk.rigctl("import", "bundle", "--store", "again.rig.sqlite").status == 0
    here, there = result_of(path), result_of(tmp_path / "again.rig.sqlite")
    for one, other in zip(here["sensitivity"], there["sensitivity"], strict=True):
        assert one["magnitude"]["value"] == pytest.approx(other["magnitude"]["value"], rel=1e-12)
    assert diagnosis_of(tmp_path / "again.rig.sqlite")["suggested"] == ["resonance"]


def test_heads_on_their_own_clock_give_the_same(made: Made) -> None:
    own = {"keyence-lkg5000": "keyence-lkg3001", "timing_pulse_s = 2.2e-3": "# no pulses: "}
    found = result_of(made(own))["sensitivity"]
    assert [each["runs"] for each in found] == [4] * 4
    for each in found:
        off = each["magnitude"]["value"] - abs(transfer(each["frequency_hz"]))
        assert abs(off) < 4.0 * each["budget"]["noise of the magnitude"]["magnitude"]


def test_runs_at_one_frequency_are_a_recording_like_any_other(made: Made, desk: Any) -> None:
    assert desk.rigctl("export", made(), "bundle").status == 0
    rows = desk.directory / "bundle" / "runs.csv"
    head, *runs = rows.read_text().splitlines()
    place = head.split(",").index("frequency_hz")
    alone = [run for run in runs if run.split(",")[place] == "3.15"]
    assert len(alone) == 4
    rows.write_text("\n".join([head, *alone]) + "\n")
    assert desk.rigctl("import", "bundle", "--store", "one.rig.sqlite").status == 0
    for command in ("result", "compare", "diagnose", "next"):
        found = desk.rigctl(command, "one.rig.sqlite", "--json")
        assert found.status == 0, f"{command}: {found.err}"


@pytest.mark.parametrize("effects", [["resonance", "time-skew"], ["time-skew", "resonance"]])
def test_effects_alike_near_zero_are_fitted_together_without_one_before_the_other(
    made: Made, effects: list[str]
) -> None:
    late_s = 2e-4
    with Store.open(made({"frequency_hz = 42.0\n": f"frequency_hz = 42.0\nlate_s = {late_s}\n"})) as store:
        attempt = Attempt(workbench_of(store).study, [Term(effect) for effect in effects])
    found = attempt.estimates()
    assert not attempt.held
    w0 = 2.0 * math.pi * F0_HZ
    for name, truth in (("tau", late_s), ("inv_w0_squared", w0**-2.0), ("damping", 1.0 / (w0 * Q))):
        assert abs(found[name].value - truth) < 4.0 * found[name].sigma


def test_what_to_measure_next_is_what_the_rig_can_do(made: Made, desk: Any) -> None:
    path = made(LATE)
    (desk.directory / "frequency-response-rig.toml").write_text(files({}, LATE)[1])
    found = desk.rigctl("next", path, "--json", "--write", "next.toml")
    assert found.status == 0, found.err
    written = tomllib.loads((desk.directory / "next.toml").read_text())["procedure"]
    assert written["mounting"] == "kept"
    assert {run["direction"] for run in written["runs"]} <= {"forward", "reversed"}
    # A record has at least eight samples a period.
    assert all(run["frequency_hz"] <= 25.0 for run in written["runs"])


@pytest.mark.parametrize("name", ["laser_1_mm", "stage_x_mm"])
def test_a_column_in_metres_is_refused(made: Made, desk: Any, name: str) -> None:
    assert desk.rigctl("export", made(), "bundle").status == 0
    run = next((desk.directory / "bundle" / "runs").glob("*.csv"))
    head, *rows = [line.split(",") for line in run.read_text().splitlines()]
    place = head.index(name)
    scaled = [[f"{1e-3 * float(v):.9f}" if i == place else v for i, v in enumerate(row)] for row in rows]
    run.write_text("\n".join(",".join(row) for row in [head, *scaled]) + "\n")
    desk.rigctl("import", "bundle", "--store", "y.rig.sqlite").refused(2, name, "write both in mm")


@pytest.mark.parametrize(
    ("of_campaign", "of_rig", "said"),
    [
        ({"amplitude_max_mm = 20.0": "amplitude_max_mm = 30.0"}, {}, "stage: 30 mm at 1.25 Hz exceeds its travel"),
        (
            {"sample_rate_hz = 200.0": "sample_rate_hz = 10.0"},
            {},
            "c.toml: procedure.sample_rate_hz: 10 Hz is too slow for 20 Hz; at least 160 Hz",
        ),
        ({"accelerations_m_s2 = [0.2, 1.0, 4.0]\n": ""}, {}, "say what to sweep"),
        ({}, {"timing_pulse_s = 2.2e-3": "timing_pulse_s = 4e-3"}, "lower the rate"),
    ],
)
def test_what_cannot_be_done_is_refused_with_the_mend(
    of_campaign: dict[str, str], of_rig: dict[str, str], said: str
) -> None:
    campaign, rig = files(of_campaign, of_rig)
    with pytest.raises((ConfigError, LimitError)) as error:
        runner.dry_run(parse_campaign(campaign, Path("c.toml")), parse_rig(rig, Path("r.toml")))
    assert said in str(error.value)
    assert len(str(error.value).splitlines()) == 1
