"""The scan on a twin: its order, its approaches, its refusals; and a store that a further campaign goes on in."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from procedures.sensing_axis import sensing_axes
from procedures.sensing_axis.mounting import Mounting, Seated
from procedures.sensing_axis.scan import stretches
from procedures.sensing_axis.tables import Procedure, Targets
from rigctl.effects.catalogue import chosen

GRID: dict[str, Any] = {
    "name": "scan",
    "axes": ("X",),
    "configurations": ("flag",),
    "angles_deg": (-1.0, 0.5, 20.0),
    "frequencies_hz": (0.5, 0.6),
    "approaches": (1, -1),
    "dwell_s": 4.0,
    "order_seed": 3,
}


def procedure(**changes: Any) -> Procedure:
    return Procedure.model_validate({**GRID, **changes})


def names(seated: Seated | None = None, **changes: Any) -> list[str]:
    found = stretches(procedure(**changes), seated or Seated())
    return [wanted.name for stretch in found for wanted in stretch.wanted]


def plan(**changes: Any) -> sensing_axes.Plan:
    return sensing_axes.Plan(procedure(**changes), Targets(), chosen("sensing-axis", ["roll-gravity"]))


def test_every_combination_is_measured_once_in_a_random_order_that_the_seed_repeats() -> None:
    listed = names(order="as-listed")
    shuffled = names()
    assert len(listed) == len(set(listed)) == 12
    assert sorted(shuffled) == sorted(listed)
    assert shuffled != listed
    assert names() == shuffled
    assert names(order_seed=4) != shuffled


def test_repeats_and_amplitudes_multiply_and_each_mounting_has_an_order_of_its_own() -> None:
    found = stretches(procedure(repeats=2, amplitudes_mm=(2.0, 5.0), axes=("X", "Y")), Seated())
    assert [stretch.mounting for stretch in found] == [Mounting("X", "flag", 1), Mounting("Y", "flag", 2)]
    first, second = ([wanted.name for wanted in stretch.wanted] for stretch in found)
    assert len(set(first)) == 48
    assert sorted(first) == sorted(second)
    assert first != second


def test_a_list_is_measured_by_mounting_and_room_and_takes_from_the_procedure_what_it_leaves_out() -> None:
    runs = (
        {"theta_deg": 0.1, "frequency_hz": 0.6, "mounting": 1, "temperature_c": 22.0},
        {"theta_deg": 0.2, "frequency_hz": 0.6, "mounting": 2, "axis": "Y", "dwell_s": 9.0},
        {"theta_deg": 0.3, "frequency_hz": 0.6, "mounting": 0, "amplitude_mm": 2.0},
        {"theta_deg": 0.4, "frequency_hz": 0.6, "mounting": 1, "temperature_c": 24.0},
        {"theta_deg": 0.5, "frequency_hz": 0.6, "temperature_c": 22.0},
    )
    seated = Seated(4, Mounting("X", "flag", 4))
    found = stretches(procedure(angles_deg=(), runs=runs), seated)
    assert [stretch.mounting.key for stretch in found] == ["X flag 4", "X flag 5", "Y flag 6"]
    old, new, other = ([wanted.point for wanted in stretch.wanted] for stretch in found)
    assert [(p.theta_deg, p.amplitude_mm, p.dwell_s, p.mounting) for p in old] == [(0.3, 2.0, 4.0, 4)]
    assert {p.theta_deg for p in new[:2]} == {0.1, 0.5}
    assert new[2].theta_deg == 0.4
    assert [(p.dwell_s, p.amplitude_mm) for p in other] == [(9.0, 5.0)]


def test_runs_arrive_from_the_side_asked_for_and_say_so(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=21)
    sensing_axes.run(twin.session, twin.bench, plan(angles_deg=(-0.5, 0.5), frequencies_hz=(0.6,)))
    runs = twin.store.runs()
    assert len(runs) == 4
    assert sorted((run.conditions["theta_deg"], run.conditions["approach"]) for run in runs) == pytest.approx(
        np.array([(-0.5, -1), (-0.5, 1), (0.5, -1), (0.5, 1)]), abs=2e-4
    )


def test_nature_feels_the_side_an_angle_was_reached_from(make_twin: Callable[..., Any]) -> None:
    h = 1e-4
    twin = make_twin(seed=22, effects={"cable-hysteresis": {"h": h}})
    sensing_axes.run(twin.session, twin.bench, plan(angles_deg=(0.5,), frequencies_hz=(0.6,), dwell_s=10.0))
    in_phase = {}
    for run in twin.store.runs():
        samples = twin.store.samples(run.run_id)
        x = samples["stage_x_mm"] - samples["stage_x_mm"].mean()
        in_phase[run.conditions["approach"]] = float(samples["accel_v"] @ x / (x @ x)) * 5.0
    response = 1.0 / (1.0 - (0.6 / 3.5) ** 2)
    expected = -100.0 * response * 5e-3 * (2.0 * math.pi * 0.6) ** 2 * 2.0 * h
    assert abs(in_phase[1] - in_phase[-1]) == pytest.approx(abs(expected), rel=0.05)


def test_lasers_are_left_out_where_their_spots_would_leave_the_cube(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=23)
    sensing_axes.run(twin.session, twin.bench, plan(approaches=(1,), frequencies_hz=(0.6,)))
    for run in twin.store.runs():
        lasers = {name for name in twin.store.samples(run.run_id) if name.startswith("laser_")}
        assert bool(lasers) is (run.conditions["theta_asked_deg"] < 2.0)
        assert run.valid


@pytest.mark.parametrize(
    ("changes", "facts"),
    [
        ({"angles_deg": ()}, ["procedure.angles_deg is missing", "[[procedure.runs]]"]),
        ({"runs": ({"theta_deg": 0.0, "frequency_hz": 0.5},)}, ["angles_deg and runs", "leave one out"]),
        ({"mounting": "same"}, ["nothing is mounted yet"]),
        ({"axes": ("Q",)}, ["procedure.axes", "no axis Q", "X, Y, Z"]),
        ({"configurations": ("upside-down",)}, ["no configuration upside-down"]),
        (
            {"angles_deg": (), "runs": ({"theta_deg": 0.0, "frequency_hz": 0.5, "axis": "W"},)},
            ["procedure.runs.0.axis", "no axis W"],
        ),
        ({"angles_deg": (-170.0,)}, ["outside -169.95", "approach from below"]),
        ({"angles_deg": (170.0,)}, ["169.95 deg", "approach from above"]),
        ({"angles_deg": (90.0,), "frequencies_hz": (1.0,)}, ["90 deg", "past the 10 V", "less amplitude"]),
        ({"amplitudes_mm": (30.0,)}, ["30 mm", "exceeds its travel"]),
    ],
)
def test_what_cannot_be_done_is_refused_in_a_line_before_anything_moves(
    desk: Any, wire: Any, changes: dict[str, Any], facts: list[str]
) -> None:
    desk.campaign(text=_toml({**GRID, **changes}))
    desk.run().refused(2, "campaign.toml", *facts)
    assert wire.motions == []
    assert not desk.store.exists()


@pytest.mark.parametrize(
    ("key", "value", "facts"),
    [
        ("approaches", [1, 0], ["procedure.approaches.1"]),
        ("approaches", [], ["procedure.approaches"]),
        ("repeats", 0, ["procedure.repeats", "not 0"]),
        ("order", "backwards", ["procedure.order", "backwards"]),
        ("runs", [{"frequency_hz": 0.5}], ["procedure.runs.0.theta_deg is missing"]),
        ("runs", [{"theta_deg": 0.0, "frequency_hz": 0.5, "speed": 1}], ["unknown key procedure.runs.0.speed"]),
    ],
)
def test_bad_keys_are_named(desk: Any, key: str, value: Any, facts: list[str]) -> None:
    desk.campaign(text=_toml({**GRID, key: value}))
    desk.run().refused(2, "campaign.toml", *facts)


def _toml(procedure: dict[str, Any], effects: str = "[]") -> str:
    keys = {key: list(value) if isinstance(value, tuple) else value for key, value in procedure.items()}
    runs = keys.pop("runs", [])
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    listed = [
        "[[procedure.runs]]\n" + "\n".join(f"{key} = {json.dumps(value)}" for key, value in run.items())
        for run in runs
    ]
    head = 'experiment = "sensing-axis"\nrig = "rig.toml"\n\n[procedure]\n'
    return head + "\n".join([*lines, *listed]) + f"\n[model]\neffects = {effects}\n"


def test_the_room_is_brought_to_each_temperature_once_and_the_sensor_feels_it(make_twin: Callable[..., Any]) -> None:
    twin = make_twin(seed=24, effects={"thermal-gain": {"kT": 1e-2}})
    runs = tuple(
        {"theta_deg": 20.0, "frequency_hz": 0.6, "temperature_c": celsius} for celsius in (22.0, 26.0, 22.0, 26.0)
    )
    asked: list[float] = []
    bring = twin.session.operator.bring_room_to
    twin.session.operator.bring_room_to = lambda celsius: (asked.append(celsius), bring(celsius))[1]
    sensing_axes.run(twin.session, twin.bench, plan(angles_deg=(), runs=runs))
    assert asked == [22.0, 26.0]
    found = [
        (run.conditions["temperature_c"], twin.store.samples(run.run_id)["accel_v"]) for run in twin.store.runs()
    ]
    assert [celsius for celsius, _ in found] == pytest.approx([22.0, 22.0, 26.0, 26.0], abs=0.05)
    cool, warm = (float(np.std(found[i][1])) for i in (0, 2))
    assert warm / cool == pytest.approx((1 + 1e-2 * 6.0) / (1 + 1e-2 * 2.0), rel=2e-3)
