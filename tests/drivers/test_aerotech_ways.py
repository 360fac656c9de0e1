"""How the Ensemble driver oscillates and captures: by its program or by ASCII; and what only motion tells."""

from __future__ import annotations

import importlib.resources
import re
from typing import Any

import numpy as np
import pytest

from drivers import aerotech_program
from rigctl.core.errors import InstrumentError, LimitError
from rigctl.core.interfaces import LearnsByMoving
from simulators.aerotech_ensemble import GENTLE, EnsembleDialect
from simulators.aerotech_ensemble.tasks import OURS
from tests.drivers.ensemble_bench import ASCII, BY_ASCII, Bench

WAYS = pytest.mark.parametrize("way", [{}, ASCII], ids=["program", "ascii"])


def source() -> str:
    return (importlib.resources.files("drivers") / "aerobasic" / "rigctl.ab").read_text(encoding="ascii")


def test_the_program_comes_with_the_drivers_and_numbers_its_registers_as_they_do() -> None:
    defined = {name: int(number) for name, number in re.findall(r"DEFINE (\w+) (\d+)", source())}
    ours = aerotech_program
    assert defined == {
        "programVersion": ours.VERSION,
        "actionRegister": ours.ACTION,
        "resultRegister": ours.RESULT,
        "axisRegister": ours.AXIS,
        "firstRegister": ours.FIRST,
        "triggerRegister": ours.TRIGGER,
        "pointsRegister": ours.POINTS,
        "versionRegister": ours.PROGRAM_VERSION,
        "distanceRegister": ours.DISTANCE,
        "frequencyRegister": ours.FREQUENCY,
        "tellVersion": ours.TELL_VERSION,
        "oscillateAxis": ours.OSCILLATE,
        "armCapture": ours.ARM,
        "readCapture": ours.READ,
        "endCapture": ours.END,
    }


def test_what_there_is_is_found_out_before_anything_moves() -> None:
    bench = Bench().opened()
    bench.stage.home()
    lines = bench.tap.lines
    assert lines.index('PROGRAM RUN 2, "rigctl.bcx"') < lines.index("ENABLE X")
    ascii_bench = Bench(**ASCII).opened()
    ascii_bench.stage.home()
    lines = ascii_bench.tap.lines
    assert lines.index("OSCILLATE X, 0.001, 1, 1, 1") < lines.index("ENABLE X")
    assert not ascii_bench.axis.moving(0.0)


@pytest.mark.parametrize(("frequencies", "ending"), [("required", ", 1"), ("optional", ", 1"), ("unknown", "")])
def test_how_oscillate_is_written_is_found_out(frequencies: str, ending: str) -> None:
    dialect = BY_ASCII | {"oscillate_frequencies": frequencies}
    bench = Bench(**ASCII | {"simulated": {"dialect": dialect, "rigctl_program": False}}).homed()
    bench.stage.oscillate(0.0, 1.0, 0.5, 10.0)
    assert bench.tap.sent("OSCILLATE") == [f"OSCILLATE X, 1, 0.5, 5{ending}"]


def test_an_axis_found_enabled_is_disabled_while_oscillate_is_asked_about() -> None:
    bench = Bench(**ASCII).homed()
    bench.stage.close()
    bench.stage.open()
    bench.stage.oscillate(0.0, 1.0, 0.5, 10.0)
    lines = bench.tap.lines
    disabled, asked, enabled = map(lines.index, ("DISABLE X", "OSCILLATE X, 0.001, 1, 1, 1", "ENABLE X"))
    assert disabled < asked < enabled
    assert lines[enabled + 1] == "WAIT MODE NOWAIT"


def test_a_controller_that_has_neither_still_moves_and_says_so_when_it_shall_oscillate() -> None:
    bench = Bench(simulated={"rigctl_program": False}).homed()
    bench.stage.move_to(1.0)
    for act in (lambda: bench.stage.oscillate(0.0, 1.0, 0.5, 10.0), lambda: bench.stage.arm(5, 0.01)):
        with pytest.raises(InstrumentError, match=r"no program 'rigctl\.bcx' and does not .* compile .*rigctl\.ab"):
            act()


def test_another_version_of_the_program_is_refused() -> None:
    older = source().replace("programVersion 1", "programVersion 7")
    bench = Bench(simulated={"rigctl_program": False, "programs": {OURS: older}}).homed()
    with pytest.raises(InstrumentError, match=r"is version 7, this driver's is 1; compile and load"):
        bench.stage.arm(5, 0.01)


@pytest.mark.parametrize("few", [{"integer_registers": 6}, {"double_registers": 1}])
def test_too_few_registers_are_told_before_any_is_used(few: dict[str, int]) -> None:
    bench = Bench(simulated=few, capture_registers=1).homed()
    with pytest.raises(InstrumentError, match=r"integer and .* double registers, rigctl\.bcx needs 7 and 2; raise"):
        bench.stage.oscillate(0.0, 1.0, 0.5, 10.0)
    assert not [line for line in bench.tap.lines if "GLOBAL(" in line and "=" in line]


def test_a_task_that_is_not_enabled_is_named() -> None:
    # It acknowledges, and never begins.
    bench = Bench(simulated={"dialect": {"program_start_s": 1000.0}}).homed()
    with pytest.raises(
        InstrumentError, match=r"has not done action 1 after 5 s .*TASKSTATE\(2\) is 1.*TaskExecution"
    ):
        bench.stage.arm(5, 0.01)


def test_a_stop_while_the_program_is_about_to_begin_leaves_the_axis_at_rest() -> None:
    bench = Bench(simulated={"dialect": {"program_start_s": 0.5}}).homed()

    def stop_now(line: str) -> bool:
        if line == 'PROGRAM RUN 1, "rigctl.bcx"':
            bench.clock.call_at(bench.clock.now_s() + 0.1, lambda: None)
            bench.ensemble.controller.abort()
        return True

    bench.tap.on_line = stop_now
    bench.stage.oscillate(0.0, 1.0, 0.5, 100.0)
    bench.tap.on_line = lambda _: True
    bench.stage.stop()
    bench.clock.sleep_s(2.0)
    assert bench.at_rest()
    assert bench.tap.sent("PROGRAM STOP")[-1] == "PROGRAM STOP 1"


@WAYS
def test_an_oscillation_while_another_captures_gives_each_its_own(way: dict[str, Any]) -> None:
    simulated = way.get("simulated", {}) | {"integer_registers": 200}
    bench = Bench(**way | {"simulated": simulated}).homed()
    for amplitude_mm in (2.0, 3.0):
        bench.stage.oscillate(0.0, amplitude_mm, 0.5, 60.0)
        bench.stage.arm(150, 0.02)
        first_s = bench.clock.now_s() + 0.2
        bench.line.begin(first_s, 0.02, 150)
        bench.clock.sleep_s(4.0)
        rows = bench.stage.collect()
        expected_mm = bench.axis.sample(first_s + 0.02 * np.arange(150))[0]
        np.testing.assert_allclose(rows[:, 0], expected_mm, atol=2.5e-6 + 1e-12)
        assert np.ptp(rows) > 1.9 * amplitude_mm


@pytest.mark.parametrize("switch", ["", *EnsembleDialect.model_fields])
@pytest.mark.parametrize("short", [False, True], ids=["complete", "an edge missing"])
def test_a_capture_is_right_or_refused_whatever_reading_the_controller_has(switch: str, short: bool) -> None:
    hardest = EnsembleDialect()
    dialect = GENTLE.model_copy(update={switch: getattr(hardest, switch)}) if switch else hardest
    bench = Bench(simulated={"dialect": dialect}, oscillate_distance=dialect.oscillate_distance).homed()
    bench.stage.oscillate(0.0, 2.0, 0.5, 60.0)
    for _ in range(2):
        bench.stage.arm(40, 0.02)
        first_s = bench.clock.now_s() + 0.2
        bench.line.begin(first_s, 0.02, 40 - short)
        bench.clock.sleep_s(2.0)
        if short:
            with pytest.raises(InstrumentError, match="fewer positions captured than the 40"):
                bench.stage.collect()
        else:
            expected_mm = bench.axis.sample(first_s + 0.02 * np.arange(40))[0]
            np.testing.assert_allclose(bench.stage.collect()[:, 0], expected_mm, atol=2.5e-6 + 1e-12)


# what only motion tells


@WAYS
@pytest.mark.parametrize("reading", ["peak-to-peak", "amplitude"])
def test_a_millimetre_tells_what_the_distance_is(way: dict[str, Any], reading: str) -> None:
    dialect = {"oscillate_distance": reading} | (BY_ASCII if way else {})
    simulated = {"dialect": dialect, "rigctl_program": not way}
    bench = Bench(**way | {"simulated": simulated, "oscillate_distance": "unknown", "oscillate_answers": "unknown"})
    stage = bench.homed().stage
    assert isinstance(stage, LearnsByMoving)
    keys = ("oscillate_distance", "oscillate_answers")[: 2 if way else 1]
    assert stage.unknown_until_moved() == keys
    with pytest.raises(InstrumentError, match="let a supervised millimetre tell"):
        stage.oscillate(0.0, 2.0, 0.5, 10.0)
    assert not bench.tap.sent("MOVEABS")
    began_s = bench.clock.now_s()
    learned = stage.learn_by_moving()
    way_mm = bench.axis.sample(np.linspace(began_s, bench.clock.now_s(), 5000))[0]
    assert np.ptp(way_mm) < 1.001
    assert [each.key for each in learned] == list(keys)
    assert learned[0].value == reading
    assert "mm for a distance of 0.5 mm" in learned[0].measured
    assert stage.unknown_until_moved() == ()
    stage.oscillate(0.0, 2.0, 0.5, 10.0)
    swing_mm = bench.axis.sample(bench.clock.now_s() + np.linspace(0.0, 4.0, 1000))[0]
    assert (swing_mm.min(), swing_mm.max()) == pytest.approx((-2.0, 2.0), abs=1e-3)


def test_an_oscillate_that_is_answered_at_its_end_is_not_used_over_ascii() -> None:
    simulated = {"dialect": BY_ASCII | {"oscillate_waits": "always"}, "rigctl_program": False}
    bench = Bench(**ASCII | {"simulated": simulated, "oscillate_answers": "unknown"}).homed()
    with pytest.raises(InstrumentError, match=r"answered only when the motion has ended.*load the program"):
        bench.stage.learn_by_moving()
    with pytest.raises(InstrumentError, match="oscillate_answers of this controller's OSCILLATE not known"):
        bench.stage.oscillate(0.0, 2.0, 0.5, 10.0)


def test_an_oscillate_that_no_status_shows_is_not_used_over_ascii() -> None:
    simulated = {"dialect": BY_ASCII | {"oscillate_shows": False}, "rigctl_program": False}
    bench = Bench(**ASCII | {"simulated": simulated}).homed()
    with pytest.raises(InstrumentError, match=r"AXISSTATUS does not show.*load the program"):
        bench.stage.learn_by_moving()


def test_a_motion_that_is_neither_is_told_with_what_was_measured() -> None:
    # A second harmonic half as large as the fundamental: no reading of the distance gives this travel.
    bench = Bench(oscillate_distance="unknown", simulated={"harmonics": (0.5,)}).homed()
    with pytest.raises(InstrumentError, match=r"went from -?0\.000 to 1\.125 mm, neither"):
        bench.stage.learn_by_moving()
    assert bench.at_rest()


def test_the_trial_needs_room() -> None:
    bench = Bench(oscillate_distance="unknown", position_max_mm=2.0).homed()
    bench.stage.move_to(1.5)
    with pytest.raises(LimitError, match="outside the travel"):
        bench.stage.learn_by_moving()
