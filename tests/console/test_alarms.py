"""What is wrong is seen as long as it is so, and what is old is seen to be old."""

from __future__ import annotations

import os
import shutil
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from rigctl.analysis.run_misfit import RunMisfit
from rigctl.campaign.recording import Header, RunRecord
from rigctl.campaign.session import locks
from rigctl.campaign.session.heartbeat import STALLED_S, beat
from rigctl.campaign.session.questions import Question
from rigctl.campaign.store.entries import BACK, LOST, RESUMED, Event
from rigctl.campaign.store.store import Store
from rigctl.console import analyses, telling
from rigctl.console.alarms import Alarm, alarms_of
from rigctl.console.analyst import Analyst
from rigctl.console.readings import recorded_instruments
from rigctl.console.screens.rig import _rows
from rigctl.console.store_view import StoreView
from rigctl.console.telling import Bell, Notes
from rigctl.console.vitals import NOTHING_RECORDED_S, Vitals
from rigctl.console.widgets.bars import AlarmStrip
from rigctl.core.making_safe import Rest
from rigctl.report.shown import Watch

STORE = Path("night.rig.sqlite")
RIG = '[instruments.oven]\nrole = "thermometer"\ndriver = "x"\naddress = "{address}"\n'


def seen(*, alive: bool = True, question: Question | None = None, address: str = "tcp:a:1", **more: Any) -> StoreView:
    status = {"state": "running" if alive else "interrupted", "step": "axis Y", "killed": not alive}
    events = more.pop("events", ())
    return StoreView(STORE, status, alive, (), events, {}, question, rig_toml=RIG.format(address=address), **more)


def signs(beat_age_s: float, written_age_s: float) -> Vitals:
    now_s = time.monotonic()
    return Vitals(STORE, True, now_s - beat_age_s, now_s - written_age_s)


def test_a_campaign_without_a_heartbeat_is_stalled_on_every_screen_until_it_beats(
    tmp_path: Path, at_console: Any
) -> None:
    path = tmp_path / "night.rig.sqlite"
    with Store.create(path, Header(experiment="sensing-axis")):
        pass

    async def sitting(seat: Any) -> None:
        await seat.sees("! STALLED: no sign of life of the campaign for 60 min")
        await seat.sees("STALLED 0/0")
        await seat.press("2")
        await seat.sees("✗ STALLED")
        await seat.sees("time left unknown")
        await seat.press("5")
        await seat.sees("! STALLED")
        beat(path)
        await seat.until(lambda: "STALLED" not in seat.text)

    with locks.held(locks.store_lock(path), "held"):
        hour_ago = time.time() - 3600.0
        os.utime(locks.store_lock(path), (hour_ago, hour_ago))
        at_console(sitting, path)


def keys_of(view: StoreView | None, vitals: Vitals | None) -> list[str]:
    return [alarm.key.partition(" ")[0] for alarm in alarms_of(view, vitals, (), ())]


def test_what_is_an_alarm_of_a_campaign() -> None:
    question = Question(3, "Mount X. Type 'done': ", "")
    assert keys_of(seen(), signs(0.5, 1.0)) == []
    assert keys_of(seen(), signs(STALLED_S + 1.0, 1.0)) == ["stalled"]
    assert keys_of(seen(), signs(0.5, NOTHING_RECORDED_S + 1.0)) == ["silent"]
    # Who waits for the operator records nothing: that is no fault.
    assert keys_of(seen(question=question), signs(0.5, NOTHING_RECORDED_S + 1.0)) == ["question"]
    assert keys_of(seen(alive=False), None) == ["killed"]
    # Simulated instruments are gone with their process.
    assert keys_of(seen(alive=False, address="sim:oven"), None) == []


def test_what_the_runs_tell_is_worked_out_once_more_as_soon_as_a_campaign_has_ended(
    measured: Path, tmp_path: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "night.rig.sqlite"
    shutil.copy(measured, path)
    looks = []

    async def found(_: Analyst, what: str, *_arguments: Any, live: bool = False) -> Watch:
        assert (what == "watched") == live
        looks.extend([what] if live else [])
        return Watch((), ())

    monkeypatch.setattr(Analyst, "ask", found)
    monkeypatch.setattr(analyses, "LIVE_S", 3600.0)

    async def sitting(seat: Any) -> None:
        await seat.press("2")
        await seat.until(lambda: len(looks) == 1)
        at_work.close()
        await seat.until(lambda: len(looks) == 2)

    with ExitStack() as at_work:
        at_work.enter_context(locks.held(locks.store_lock(path), "held"))
        at_console(sitting, path)


def told(number: int, kind: str, **data: str) -> Event:
    return Event(number, "2026-11-29T22:23:00+00:00", None, kind, data)


def test_an_instrument_that_the_campaign_waits_for_is_an_alarm_until_it_is_back() -> None:
    lost = told(1, LOST, instrument="rotation", text="rotation: no connection; check power and cable")
    (alarm,) = alarms_of(seen(events=(lost,)), signs(0.5, 1.0), (), ())
    assert alarm.text == ("rotation LOST: no connection; check power and cable. The campaign waits until it answers")
    assert keys_of(seen(events=(lost, told(2, BACK))), signs(0.5, 1.0)) == []
    assert keys_of(seen(events=(lost, told(2, RESUMED))), signs(0.5, 1.0)) == []
    assert keys_of(seen(alive=False, events=(lost,), address="sim:oven"), None) == []


def test_signs_of_life_of_another_store_are_not_this_one_s() -> None:
    other = Vitals(Path("other.rig.sqlite"), True, time.monotonic() - 3600.0, time.monotonic())
    assert keys_of(seen(), other) == []


def test_who_has_not_confirmed_to_be_at_rest_stays_the_first_alarm() -> None:
    unsafe = [Rest("stage", False, 5.0, "no answer within 5 s")]
    first, second = alarms_of(seen(), signs(60.0, 1.0), (), unsafe)
    assert first.text == "stage: NOT CONFIRMED: no answer within 5 s; look at it"
    assert second.key.startswith("stalled")


def test_a_run_far_from_the_model_is_an_alarm_until_it_is_left_out(
    measured: Path, tmp_path: Path, at_console: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As worked out anew whenever a run has come or has been marked, on every screen, while the campaign runs."""
    path = tmp_path / "night.rig.sqlite"
    shutil.copy(measured, path)

    async def found(_: Analyst, what: str, store: Path, *_arguments: Any, live: bool = False) -> Watch:
        assert (what == "watched") == live
        with Store.open(store, readonly=True) as opened:
            spoilt = [run.run_id for run in opened.runs(valid_only=True) if run.run_id in {"3", "7"}]
        return Watch((), tuple(RunMisfit(run_id, -4.0 - int(run_id), "accel_v", "DC") for run_id in spoilt))

    monkeypatch.setattr(Analyst, "ask", found)
    monkeypatch.setattr(analyses, "LIVE_S", 0.1)

    async def sitting(seat: Any) -> None:
        await seat.press("5")
        await seat.sees("! Run 7 is 11 sigma off the model in accel_v (and 1 more): 2 m, 4 g")
        with Store.open(path) as opened:
            opened.mark("7", False, "the door")
        await seat.sees("! Run 3 is 7 sigma off the model in accel_v: 2 m, 4 g")
        with Store.open(path) as opened:
            opened.mark("3", False, "the door again")
        await seat.until(lambda: "sigma off" not in seat.text)

    with locks.held(locks.store_lock(path), "held"):
        beat(path)
        at_console(sitting, path)


def test_the_bell_rings_for_what_is_new_and_again_for_what_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, rung = [1000.0], []
    monkeypatch.setattr(telling.time, "monotonic", lambda: now_s[0])
    bell = Bell(lambda: rung.append(now_s[0]))
    lost, asked = Alarm("lost stage", ""), Alarm("question a 1", "")
    for at_s, alarms in ((0, [lost]), (20, [lost]), (21, [lost, asked]), (25, [asked]), (32, [asked]), (50, [lost])):
        now_s[0] = 1000.0 + at_s
        bell.hear(alarms)
    assert [at_s - 1000.0 for at_s in rung] == [0, 21, 32, 50]


def test_an_error_is_not_pushed_away_by_what_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(telling.time, "monotonic", lambda: now_s[0])
    notes = Notes()
    notes.tell("it failed", "error")
    notes.tell("saved", "information")
    assert notes.text([]).plain == "✗ it failed"
    now_s[0] += telling.ERROR_S + 1.0
    assert notes.text(["fit of x, 3 s"]).plain == "… fit of x, 3 s"


def test_a_recorded_value_is_as_old_as_the_run_it_was_measured_in() -> None:
    run = RunRecord("1", "", "", {"temperature_c": 21.5})
    view = seen(run_ended_s=time.monotonic() - 2.0 * 3600.0, sampled_s=time.monotonic())
    (oven,) = recorded_instruments(StoreView(**{**vars(view), "runs": (run,)}))
    ((_, row),) = _rows(oven)
    assert row[2:5] == ("temperature", "21.50 degC", "2.0 h!")


def test_alarms_that_do_not_fit_have_a_row_each_and_what_is_beyond_is_counted(at_console: Any) -> None:
    why = "no connection, cannot open /dev/ttyUSB0; check power and cable, then reconnect"

    async def sitting(seat: Any) -> None:
        strip = seat.app._base.query_one(AlarmStrip)

        async def told(names: str) -> list[str]:
            seat.app._unsafe = {name: Rest(name, False, 5.0, why) for name in names}
            await seat.sees(f"! {names[0]}: NOT CONFIRMED")
            return [line.strip() for line in seat.text.splitlines()[2 : 2 + strip.size.height]]

        assert len(await told("abc")) == 6
        rows = await told("defgh")
        assert [row[:3] for row in rows] == ["! d", "! e", "! f", "! g", "! h"]
        assert all(row.endswith("…") for row in rows)
        rows = await told("ijklmno")
        assert len(rows) == 6
        assert rows[-1] == "! and 2 more: 5 has all"

    at_console(sitting)
