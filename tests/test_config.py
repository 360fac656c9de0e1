"""Rig and campaign files: what is accepted, and every complaint in one line."""

from __future__ import annotations

import copy
import itertools
import math
import tomllib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from procedures.frequency_response import tables as response_tables
from procedures.inflight import tables as inflight
from procedures.rotating_platform import tables as platform_tables
from procedures.sensing_axis import tables
from procedures.sensing_axis.campaign import plan as plan_of
from procedures.sensing_axis.wiring import bench_of
from rigctl import runner
from rigctl.core.errors import ConfigError, LimitError
from rigctl.core.toml import to_toml
from rigctl.files.campaign_file import CampaignFile, parse_campaign, read_campaign
from rigctl.files.rig_file import RigFile, only_tables, parse_rig, read_rig
from rigctl.rig import Rig

CAMPAIGNS = Path(__file__).parents[1] / "campaigns"
RIG = tomllib.loads((CAMPAIGNS / "isa-rig.toml").read_text())
CAMPAIGN = tomllib.loads((CAMPAIGNS / "isa-flight-model.toml").read_text())
SHIPPED = sorted(path.name for path in CAMPAIGNS.glob("*.toml") if "rig" not in path.name)


def complaint(error: pytest.ExceptionInfo[Exception], *facts: str) -> str:
    text = str(error.value)
    assert len(text.splitlines()) == 1
    for fact in facts:
        assert fact in text
    return text


def rig_error(text: str) -> str:
    with pytest.raises(ConfigError) as error:
        parse_rig(text, Path("rig.toml"))
    return complaint(error, "rig.toml: ")


def campaign_error(text: str) -> str:
    with pytest.raises(ConfigError) as error:
        plan_of(parse_campaign(text, Path("campaign.toml")))
    return complaint(error, "campaign.toml: ")


def changed(data: dict[str, Any], *keys: str, **entries: Any) -> str:
    """TOML text of the data with entries of one table set, or removed where None."""
    copied = copy.deepcopy(data)
    table = copied
    for key in keys:
        table = table[key]
    for name, value in entries.items():
        if value is None:
            del table[name]
        else:
            table[name] = value
    return to_toml(copied)


DIRECTIONS: list[dict[str, Any]] = [
    {"coc": [1.0, 0.0, 0.0], "uoaf": [0.819152, 0.0, -0.573576], "u_arcsec": 2.0},
    {"coc": [0.0, 1.0, 0.0], "uoaf": [0.0, 1.0, 0.0], "u_arcsec": 2.0},
    {"coc": [0.0, 0.0, 1.0], "uoaf": [0.573576, 0.0, 0.819152], "u_arcsec": 2.0},
]
GIVEN = {"uoaf_from_coc": None, "uoaf_u_arcsec": None}
MIRRORED = [*DIRECTIONS[:2], {**DIRECTIONS[2], "uoaf": [-0.573576, 0.0, -0.819152]}]


def test_a_given_rotation_with_its_uncertainty_and_correlations() -> None:
    rig = parse_rig(
        changed(RIG, "package", uoaf_u_arcsec=[1.0, 2.0, 3.0], uoaf_correlation=[0.1, 0.2, -0.3]), Path("rig.toml")
    )
    assert rig.package is not None
    expected = np.array([[1.0, 0.2, -0.9], [0.2, 4.0, 1.2], [-0.9, 1.2, 9.0]]) * np.radians(1 / 3600.0) ** 2
    np.testing.assert_allclose(rig.package.uoaf_rotation().covariance, expected)


def test_the_hosts_frame_may_be_measured() -> None:
    rig = parse_rig(
        changed(RIG, "package", uoaf_from_coc=None, uoaf_u_arcsec=None, uoaf_directions=DIRECTIONS), Path("rig.toml")
    )
    assert rig.package is not None
    found = rig.package.uoaf_rotation()
    np.testing.assert_allclose(found.matrix, RIG["package"]["uoaf_from_coc"], atol=2e-6)
    # Two of the three directions know each turn.
    np.testing.assert_allclose(
        np.degrees(np.sqrt(np.diag(found.covariance))) * 3600.0, 2.0 / math.sqrt(2.0), rtol=1e-3
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_campaign_can_be_run_on_its_rig(name: str) -> None:
    campaign = read_campaign(CAMPAIGNS / name)
    plan = runner.dry_run(campaign, read_rig(campaign.rig_path))
    assert plan["experiment"] == campaign.experiment
    assert plan["runs_planned"] >= max(1, len(plan.get("mountings", ())))


def test_every_shipped_rig_can_be_built() -> None:
    for path in (CAMPAIGNS / "all-instruments.rig.toml", CAMPAIGNS / "one-axis.rig.toml", CAMPAIGNS / "isa-rig.toml"):
        assert bench_of(Rig(read_rig(path))).package.axes


@pytest.mark.parametrize(
    ("keys", "entry", "key"),
    [
        ((), {"sensors": 3}, "unknown key sensors"),
        ((), {"path": "x"}, "unknown key path"),
        ((), {"text": "x"}, "unknown key text"),
        (("rig",), {"clok": "real"}, "unknown key rig.clok; known there: name, clock, clock_speed"),
        (("package",), {"requirement": 100.0}, "unknown key package.requirement"),
        (("package", "axes", "X"), {"resonance": 3.5}, "unknown key package.axes.X.resonance"),
        (("package", "axes", "X", "sensor", "flag"), {"gain": 1.0}, "unknown key package.axes.X.sensor.flag.gain"),
        (("lasers", "laser_1_mm"), {"tilt_rad": 0.1}, "unknown key lasers.laser_1_mm.tilt_rad"),
        (("constants", "g_m_s2"), {"sigma": 0.1}, "unknown key constants.g_m_s2.sigma"),
        (("certificates", "rotation"), {"expiry": 1}, "unknown key certificates.rotation.expiry"),
    ],
)
def test_an_unknown_key_of_a_rig_file_is_named(keys: tuple[str, ...], entry: dict[str, Any], key: str) -> None:
    assert key in rig_error(changed(RIG, *keys, **entry))


@pytest.mark.parametrize(
    ("keys", "entry", "facts"),
    [
        (("rig",), {"clock": "fast"}, "rig.clock: input should be 'virtual' or 'real', not 'fast'"),
        (("rig",), {"clock_speed": 0.0}, "rig.clock_speed: input should be greater than 0, not 0.0"),
        (("rig",), {"clock_speed": "200"}, "rig.clock_speed: input should be a valid number, not '200'"),
        (("rig",), {"name": None}, "rig.name is missing; add it"),
        (("instruments", "stage"), {"address": None}, "instruments.stage.address is missing; add it"),
        (("instruments", "stage"), {"role": 3}, "instruments.stage.role: input should be a valid string, not 3"),
        (("package",), {"lever_mm": "72 mm"}, "package.lever_mm: input should be a valid number, not '72 mm'"),
        (("package",), {"requirement_arcsec": True}, "package.requirement_arcsec: input should be a valid number"),
        (("package",), {"uoaf_from_coc": [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 2.0]]}, "is no rotation matrix"),
        (("package",), {"uoaf_u_arcsec": [1.0, -1.0, 0.0]}, "package.uoaf_u_arcsec"),
        (("package",), {"uoaf_correlation": [0.9, 0.9, -0.9]}, "cannot be correlated so"),
        (("package",), {"uoaf_correlation": [0.0, 1.5, 0.0]}, "package.uoaf_correlation"),
        (("package",), {"uoaf_directions": DIRECTIONS}, "leave out uoaf_from_coc"),
        (("package",), {**GIVEN, "uoaf_directions": DIRECTIONS[:1]}, "along one line"),
        (("package",), {**GIVEN, "uoaf_directions": MIRRORED}, "fit no rotation"),
        (("package",), {**GIVEN, "uoaf_directions": [{**DIRECTIONS[0], "uoaf": [0, 0, 0]}]}, "is zero"),
        (("package", "configurations", "flag"), {"k": "+z"}, "is no right-handed triad"),
        (("package", "configurations", "flag"), {"k": "up"}, "package.configurations.flag.k"),
        (("package", "axes", "Y", "sensor"), {"flag": None}, "axes.Y.sensor lacks configuration flag"),
        (("certificates", "cube"), {"uncertainty": {"x": -1.0}}, "certificates.cube.uncertainty.x"),
        (("lasers", "laser_1_mm"), {"tilt_deg": 90.0}, "lasers.laser_1_mm.tilt_deg: input should be less than 90"),
        (("package", "axes", "Y"), {"nominal": [0, 0, 0]}, "package.axes.Y.nominal: is no direction; write"),
        (("package", "axes", "Y"), {"nominal": [0, 1e-200, 0]}, "package.axes.Y.nominal: is no direction; write"),
        (("package", "axes", "Y"), {"sensor": 3}, "package.axes.Y.sensor: input should be a table"),
        (("package", "axes", "Y", "sensor"), {"flag": 3}, "sensor.flag: input should be a table, not 3"),
        ((), {"world": 3}, "world: write it as tables of its own"),
    ],
)
def test_a_wrong_value_of_a_rig_file_is_named_with_what_is_allowed(
    keys: tuple[str, ...], entry: dict[str, Any], facts: str
) -> None:
    assert facts in rig_error(changed(RIG, *keys, **entry))


@pytest.mark.parametrize(
    ("keys", "entry", "facts"),
    [
        ((), {"operators": 2}, "unknown key operators"),
        ((), {"text": "x"}, "unknown key text"),
        ((), {"experiment": "sensing"}, "experiment: input should be 'sensing-axis', 'rotating-platform',"),
        ((), {"procedure": None}, "procedure is missing; add it"),
        ((), {"on_terminal_lost": "abort"}, "on_terminal_lost: input should be 'continue' or 'stop', not 'abort'"),
        (("procedure",), {"amplitude_m": 0.005}, "unknown key procedure.amplitude_m; known there: name, axes"),
        (("procedure",), {"amplitude_mm": "5"}, "procedure.amplitude_mm: input should be a valid number, not '5'"),
        (("procedure",), {"amplitude_mm": -5.0}, "procedure.amplitude_mm: input should be greater than or equal to"),
        (("procedure",), {"mountings": 2.5}, "procedure.mountings: input should be a valid integer"),
        (("procedure",), {"mountings": True}, "procedure.mountings: input should be a valid integer"),
        (("procedure",), {"mountings": 0}, "procedure.mountings: input should be greater than or equal to 1"),
        (("procedure",), {"axes": "X"}, "procedure.axes: input should be a list, not 'X'"),
        (("procedure",), {"axes": []}, "procedure.axes"),
        (("procedure",), {"axes": ["X", "X"]}, "procedure.axes: has the same entry twice"),
        (("procedure",), {"frequencies_hz": [0.5, math.inf]}, "procedure.frequencies_hz.1: inf is no quantity"),
        (("procedure",), {"dwell_s": math.nan}, "procedure.dwell_s: nan is no quantity"),
        (("procedure",), {"name": "seven-mountings"}, "procedure.name: input should be 'six-mountings'"),
        (("targets",), {"theta0_sigma_deg": 0.1}, "unknown key targets.theta0_sigma_deg"),
        (("model",), {"effects": ["roll"]}, "model.effects: "),
        (("model",), {"effects": ["yaw", "resonance", "yaw"]}, "model.effects: has yaw twice; name each effect once"),
        (("model",), {"effect": ["roll-gravity"]}, "unknown key model.effect; known there: effects"),
        (("reference", "axes"), {"X": [1.0, 0.0]}, "reference.axes.X"),
    ],
)
def test_a_wrong_entry_of_a_campaign_file_is_named(keys: tuple[str, ...], entry: dict[str, Any], facts: str) -> None:
    assert facts in campaign_error(changed(CAMPAIGN, *keys, **entry))


def test_an_unknown_effect_is_told_what_there_is() -> None:
    assert "roll-gravity" in campaign_error(changed(CAMPAIGN, "model", effects=["rol-gravity"]))


def test_several_faults_are_counted() -> None:
    assert campaign_error(changed(CAMPAIGN, "procedure", amplitude_m=1.0, speed=2)).endswith("(and 1 more)")


def test_files_that_cannot_be_read_say_why(tmp_path: Path) -> None:
    for read in (read_rig, read_campaign):
        with pytest.raises(ConfigError) as error:
            read(tmp_path / "none.toml")
        complaint(error, "none.toml: no such file")
        with pytest.raises(ConfigError) as error:
            read(tmp_path)
        complaint(error, "cannot be read: a directory; name a file")
        latin = tmp_path / "latin.toml"
        latin.write_bytes(b'title = "\xb5m"')
        with pytest.raises(ConfigError) as error:
            read(latin)
        complaint(error, "latin.toml: not UTF-8 text (byte 9)")


def test_a_byte_order_mark_is_no_part_of_a_file(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    text = to_toml(RIG)
    file.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_rig(file).text == text


@pytest.mark.parametrize(
    ("name", "quantity", "known"),
    [
        ("cube", "ortogonality_arcsec", "orthogonality_arcsec"),
        ("accel_v", "latency_ms", "latency_s, scale, clock"),
        ("laser_1_mm", "tilt_arcsec", "tilt_deg, scale, latency_s"),
        ("stage", "yaw", "yaw_rad_per_m, recoil_rad_s2_per_m, pitch_rad_per_m"),
    ],
)
def test_an_uncertainty_that_no_budget_knows_is_refused_but_not_in_a_store(
    tmp_path: Path, name: str, quantity: str, known: str
) -> None:
    file = tmp_path / "rig.toml"
    text = changed(RIG, "certificates", name, uncertainty={quantity: 1e-3})
    file.write_text(text)
    with pytest.raises(ConfigError) as error:
        read_rig(file)
    complaint(error, f"{file}: unknown key certificates.{name}.uncertainty.{quantity}; known there: {known}")
    # What was measured with it is there, and can be analysed.
    assert parse_rig(text, file).uncertainties[name] == {quantity: 1e-3}


def test_a_certificate_that_no_budget_reads_is_warned_of(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    level = {"number": "L-1", "uncertainty": {"bubble_arcsec": 5.0}}
    file.write_text(changed(RIG, "certificates", level=level, thermometer={"number": "T-2"}))
    rig = read_rig(file)
    campaign = read_campaign(CAMPAIGNS / "isa-flight-model.toml")
    (warning,) = runner.dry_run(campaign, rig)["warnings"]
    assert warning.startswith(f"{file}: certificates.level.uncertainty: no budget reads it; budgets read those of ")
    assert "warnings" not in runner.dry_run(campaign, read_rig(campaign.rig_path))


def test_a_constant_of_the_rig_that_no_result_reads_is_warned_of() -> None:
    rig = parse_rig(changed(RIG, "constants", g_ms2={"value": 9.803, "u": 1e-3}), Path("rig.toml"))
    (warning,) = runner.dry_run(read_campaign(CAMPAIGNS / "isa-flight-model.toml"), rig)["warnings"]
    assert warning.startswith("rig.toml: constants.g_ms2 is read by no result of this experiment; those read are g_m")


@pytest.mark.parametrize(
    ("entries", "warning"),
    [
        ({"configurations": ["flag"]}, "procedure.configurations: in flag alone X moves along one line of the cube"),
        ({"mountings": 1}, "procedure.mountings: 1 in each of 2 configurations give fewer than the 3 motion vectors"),
    ],
)
def test_a_dry_run_warns_of_mountings_that_tell_no_axis(entries: dict[str, Any], warning: str) -> None:
    campaign = parse_campaign(changed(CAMPAIGN, "procedure", **entries), Path("campaign.toml"))
    (told,) = runner.dry_run(campaign, parse_rig(to_toml(RIG), Path("rig.toml")))["warnings"]
    assert told.startswith(f"campaign.toml: {warning}")


@pytest.mark.parametrize("text", ["[rig", "a = ", "a = 1\na = 2", "x = [1,,2]", "[" * 5000])
def test_what_is_not_toml_is_refused_with_its_place(text: str) -> None:
    assert "not TOML" in rig_error(text)
    assert "not TOML" in campaign_error(text)


# The simulated world is separable from the text


SECRET = "3.14159e-7"


@pytest.mark.parametrize("place", ["first", "middle", "last"])
def test_the_world_leaves_the_text_and_comes_back_the_same(place: str) -> None:
    world = f"# hidden: K2 is {SECRET}\n[world]\nseed = 1\n# more of it: {SECRET}\n"
    world += f"[world.effects.quadratic]\nK2 = {SECRET}\n"
    head, tail = '[rig]\nname = "x"\n', '[instruments.a]\ndriver = "d"\naddress = "sim:"\nrole = "spare"\n'
    text = {"first": world + head + tail, "middle": head + world + tail, "last": head + tail + world}[place]
    file = parse_rig(text, Path("rig.toml"))
    kept = file.text_without_world
    assert SECRET not in kept
    assert "hidden" not in kept
    assert "world" not in tomllib.loads(kept)
    again = parse_rig(f"{kept}\n\n{only_tables(text, 'world')}", Path("rig.toml"))
    assert again.world == file.world
    assert again.world_sha256 == file.world_sha256
    assert again.instruments == file.instruments


def test_another_world_has_another_hash_and_none_has_none() -> None:
    base = '[instruments]\n[rig]\nname = "x"\n'
    hashes = {parse_rig(base + f"[world]\nseed = {n}\n", Path("r")).world_sha256 for n in (1, 2)}
    assert len(hashes) == 2
    assert parse_rig(base, Path("r")).world_sha256 is None


def test_another_file_under_the_same_name_is_another_world(tmp_path: Path) -> None:
    base = f'[instruments]\n[rig]\nname = "x"\n[world]\nseed = 1\n[world.drag]\nfile = "{tmp_path / "drag.csv"}"\n'
    rig_file = parse_rig(base, Path("r"))
    hashes = set()
    for text in ("t_s,accel_x_m_s2\n0,1e-8\n", "t_s,accel_x_m_s2\n0,2e-8\n"):
        (tmp_path / "drag.csv").write_text(text)
        hashes.add(rig_file.world_sha256)
    assert len(hashes) == 2
    (tmp_path / "drag.csv").unlink()
    with pytest.raises(ConfigError, match="which the world names, cannot be read"):
        assert rig_file.world_sha256


@pytest.mark.parametrize(
    "written",
    [
        f"world = {{ seed = 1, effects = {{ quadratic = {{ K2 = {SECRET} }} }} }}\n[rig]\nname = 'x'\n",
        f"world.seed = {SECRET}\n[rig]\nname = 'x'\n",
        f"[rig]\nname = 'x'\n['world']\nseed = {SECRET}\n",
    ],
)
def test_a_world_that_would_slip_into_the_store_is_refused(written: str) -> None:
    assert "write it as tables of its own" in rig_error(f"{written}[instruments]\n")


# Mutations: whatever is written, it is accepted or refused in one line

PRINTABLE = st.characters(exclude_categories=["C", "Zl", "Zp"])
SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 1000),
    st.integers(),
    st.floats(allow_nan=True, allow_infinity=True),
    st.text(PRINTABLE, max_size=5),
    st.sampled_from(
        ["sim:", "tcp://127.0.0.1:1", "serial:", "keysight-34465a", "spare", "rotation", "X", "pendulum"]
    ),
    st.lists(st.one_of(st.floats(), st.text(PRINTABLE, max_size=3), st.lists(st.integers(), max_size=3)), max_size=4),
    st.dictionaries(st.text("abc_", min_size=1, max_size=3), st.integers(), max_size=2),
)


def paths(data: Any, prefix: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for key, value in data.items():
        found.append((*prefix, key))
        if isinstance(value, dict):
            found += paths(value, (*prefix, key))
    return found


def mutated(data: dict[str, Any], draw: st.DataObject) -> str:
    copied = copy.deepcopy(data)
    for _ in range(draw.draw(st.integers(1, 3))):
        *keys, last = draw.draw(st.sampled_from(paths(copied)))
        table = copied
        for key in keys:
            table = table[key]
        value = table.pop(last)
        match draw.draw(st.sampled_from(["remove", "rename", "replace"])):
            case "rename":
                table[draw.draw(st.text("abcxyz_", min_size=1, max_size=8))] = value
            case "replace":
                replacement = draw.draw(SCALARS)
                if replacement is not None:
                    table[last] = replacement
    return to_toml(copied)


@settings(deadline=None, max_examples=120, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_a_mutated_file_is_accepted_or_refused_in_one_line(draw: st.DataObject) -> None:
    of_rig = draw.draw(st.booleans())
    rig_text = mutated(RIG, draw) if of_rig else to_toml(RIG)
    campaign_text = to_toml(CAMPAIGN) if of_rig else mutated(CAMPAIGN, draw)
    try:
        rig = parse_rig(rig_text, Path("rig.toml"))
        plan = runner.dry_run(parse_campaign(campaign_text, Path("campaign.toml")), rig)
    except (ConfigError, LimitError) as error:
        said = str(error)
    else:
        said = f"rig.toml: {plan['runs_planned']} runs"
    assert len(said.splitlines()) == 1
    assert said.startswith(("rig.toml: ", "campaign.toml: "))


# Extremes: the smallest and the largest numbers a field can take

EXTREMES = (5e-324, 1e-195, 1e-12, 1e12, 1e195, 1.7e308, math.inf, math.nan, -1, 0, 10**4, 10**7, 10**20)


def numbers(data: Any, prefix: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where the numbers of some TOML are; of a list the first."""
    if isinstance(data, dict):
        return [path for key, value in data.items() for path in numbers(value, (*prefix, key))]
    if isinstance(data, list):
        return numbers(data[0], (*prefix, 0))
    return [prefix] if isinstance(data, int | float) and not isinstance(data, bool) else []


def with_defaults(data: dict[str, Any]) -> dict[str, Any]:
    """A campaign with every number of its tables written out, whether it needs to be or not."""
    table = TABLES[data["experiment"], data["procedure"]["name"] == "monte-carlo"]
    defaults = {
        name: field.default
        for name, field in table.model_fields.items()
        if isinstance(field.default, int | float) and not isinstance(field.default, bool)
    }
    return {**data, "procedure": {**defaults, **data["procedure"]}}


TABLES: dict[tuple[str, bool], type[BaseModel]] = {
    ("sensing-axis", False): tables.Procedure,
    ("frequency-response", False): response_tables.Procedure,
    ("rotating-platform", False): platform_tables.Procedure,
    ("inflight-calibration", False): inflight.Calibration,
    ("inflight-calibration", True): inflight.MonteCarlo,
}


def test_a_null_search_that_would_never_end_is_refused_before_it_begins() -> None:
    rig = read_rig(CAMPAIGNS / "isa-rig.toml")
    weak = parse_campaign(changed(CAMPAIGN, "procedure", amplitude_mm=0.01), Path("campaign.toml"))
    with pytest.raises(ConfigError) as error:
        runner.dry_run(weak, rig)
    complaint(error, "campaign.toml: procedure.amplitude_mm: 0.01 mm at 0.6 Hz do not tell theta0 to", "give more")


def with_extremes(data: dict[str, Any], places: list[tuple[Any, ...]]) -> Iterator[str]:
    """TOML text with one number of it replaced, by every extreme in turn."""
    for (*keys, last), value in itertools.product(places, EXTREMES):
        copied = copy.deepcopy(data)
        table: Any = copied
        for key in keys:
            table = table[key]
        table[last] = value
        yield to_toml(copied)


def planned_or_refused(campaign: Callable[[], CampaignFile], rig: Callable[[], RigFile], refusals: list[str]) -> bool:
    """Whether a dry run plans some runs; why not, otherwise, is appended to `refusals`."""
    try:
        plan = runner.dry_run(campaign(), rig())
    except (ConfigError, LimitError) as error:
        refusals.append(str(error))
        return False
    return bool(plan["runs_planned"] > 0)


def ill_said(refusals: list[str]) -> list[str]:
    """What is not one line that begins with the file it is about."""
    named = ("campaign.toml: ", "rig.toml: ")
    return [text for text in refusals if len(text.splitlines()) != 1 or not text.startswith(named)]


@pytest.mark.parametrize("name", SHIPPED)
def test_no_number_of_a_campaign_is_too_small_or_too_large_for_a_dry_run(name: str) -> None:
    written = with_defaults(tomllib.loads((CAMPAIGNS / name).read_text()))
    rig, refusals = parse_rig((CAMPAIGNS / written["rig"]).read_text(), Path("rig.toml")), list[str]()
    places = numbers({key: written[key] for key in ("procedure", "targets") if key in written})
    accepted = [
        planned_or_refused(partial(parse_campaign, text, Path("campaign.toml")), lambda: rig, refusals)
        for text in with_extremes(written, places)
    ]
    assert any(accepted)
    assert ill_said(refusals) == []


@pytest.mark.parametrize("name", ["one-axis.toml", "bias-rejection-days.toml", "microscope.toml"])
def test_no_number_of_a_rig_is_too_small_or_too_large_for_a_dry_run(name: str) -> None:
    campaign, refusals = parse_campaign((CAMPAIGNS / name).read_text(), Path("campaign.toml")), list[str]()
    rig = tomllib.loads((CAMPAIGNS / campaign.rig).read_text())
    accepted = [
        planned_or_refused(lambda: campaign, partial(parse_rig, text, Path("rig.toml")), refusals)
        for text in with_extremes(rig, numbers(rig))
    ]
    assert any(accepted)
    assert ill_said(refusals) == []
