"""The sensing-axis experiment as the workbench sees it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rigctl.analysis.least_squares import FitResult, least_squares
from rigctl.campaign.recording import Header, ImportReport, LaserInfo, Recording, RunRecord
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.plugins import load
from rigctl.experiments.sensing_axis.study import SensingAxisModel, SensingAxisStudy
from rigctl.files.rig_file import read_rig
from rigctl.workbench.study import Candidate, Term

G, GAIN, A = 9.803, 60.0, 5e-3
THETA0 = {"X": 0.3, "Y": -0.2, "Z": 0.1}
CAMPAIGNS = Path(__file__).parents[2] / "campaigns"
FACES = {"laser_1_face": "z", "laser_2_face": "x", "laser_3_face": "y"}
PLUGIN = '''
from rigctl.effects import effect


@effect("humid", on="sensor_output_v", parameters={"bH": "V"}, typical={"bH": 1e-3})
def humid(run, bH):
    """Damp makes the bias wander."""
    return bH * (run.column("humidity") - 0.5)
'''


def recording(
    mountings: Sequence[tuple[str, str, int]] = (("X", "pendulum", 1),),
    angles: Sequence[float] = (-1.0, 0.2, 1.1),
    frequencies: Sequence[float] = (0.3, 0.6),
    heads: int = 3,
    rho1: float = 1e-4,
    noise_v: float = 2e-5,
    header: Header | None = None,
    **columns: Any,
) -> Recording:
    """Runs of a sensor on a rolling guide, mounted perfectly; `columns` map a run's number to a condition."""
    rng = np.random.default_rng(8)
    records, samples = [], {}
    settings = [(m, theta, f) for m in mountings for theta in angles for f in frequencies]
    for i, ((axis, configuration, mounting), theta_deg, frequency_hz) in enumerate(settings):
        t = np.arange(500) * 0.02
        w = 2 * math.pi * frequency_hz
        x = A * np.sin(w * t + 0.3)
        theta = math.radians(theta_deg)
        d = theta - math.radians(THETA0[axis])
        force = math.sin(d) * w**2 * x + rho1 * G * math.cos(d) * x
        readings = [x, -math.tan(theta) * x, 0 * x]
        conditions: dict[str, Any] = {
            "axis": axis,
            "configuration": configuration,
            "mounting": mounting,
            "theta_deg": theta_deg,
            "approach": 1 - 2 * (i % 2),
            "frequency_hz": frequency_hz,
            "amplitude_mm": 1e3 * A,
            "temperature_c": 20.0 + 0.1 * i,
            "start_s": 60.0 * i,
            **FACES,
            **{name: make(i) for name, make in columns.items()},
        }
        run_id = str(i + 1)
        records.append(RunRecord(run_id, run_id, "", conditions))
        samples[run_id] = {
            "t_s": t,
            "stage_x_mm": 1e3 * x,
            "accel_v": GAIN * force + 0.2 + noise_v * rng.standard_normal(len(t)),
            **{
                f"laser_{n}_mm": 1e3 * reading / math.cos(math.radians(5.0)) + 5e-5 * rng.standard_normal(len(t))
                for n, reading in enumerate(readings[:heads], start=1)
            },
        }
    lasers = {f"laser_{n}_mm": LaserInfo(tilt_deg=5.0) for n in range(1, heads + 1)}
    given = header or Header("sensing-axis", constants={"g_m_s2": G, "gain_v_per_m_s2": 100.0}, lasers=lasers)
    return Recording(given, records, samples, ImportReport(len(records)))


def fitted(model: SensingAxisModel) -> FitResult:
    given = model.observations
    return least_squares(
        lambda values: (given.value - model.predict(values)) / given.sigma,
        model.parameters,
        jacobian=lambda values: model.jacobian(values) / given.sigma[:, None],
        max_iterations=100,
    )


def candidates_of(study: SensingAxisStudy, *terms: Term) -> tuple[dict[str, list[Candidate]], dict[str, str]]:
    model = study.model(terms)
    found, refused = study.candidates(model, fitted(model).values)
    by_effect: dict[str, list[Candidate]] = {}
    for each in found:
        by_effect.setdefault(each.term.effect, []).append(each)
    return by_effect, {each.effect: each.reason for each in refused}


def test_every_component_of_every_channel_is_observed() -> None:
    observations = SensingAxisStudy(recording()).model([]).observations
    lines = [f"{h}nu {part}" for h in ("", "2 ", "3 ") for part in ("in-phase", "quadrature")]
    assert [each.component for each in observations.series if each.channel == "accel_v"] == ["DC", *lines]
    for n in (1, 2, 3):
        assert [each.component for each in observations.series if each.channel == f"laser_{n}_mm"] == lines
    assert {each.unit for each in observations.series if each.channel == "accel_v"} == {"V"}
    assert {each.unit for each in observations.series if each.channel != "accel_v"} == {"m"}
    assert len(observations.value) == 6 * 25
    assert np.isfinite(observations.sigma).all()
    assert (observations.sigma > 0).all()


def test_parameters_are_named_and_measured_as_the_commands_say() -> None:
    model = SensingAxisStudy(recording()).model([Term("roll-gravity"), Term("thermal-gain")])
    shown = dict(zip((each.name for each in model.parameters), model.units, strict=True))
    assert shown == {
        "theta0[X,pendulum,1]": "deg",
        "gain[X,pendulum]": "V/(m/s2)",
        "dc[X,pendulum,1]": "V",
        "delta_x[X,pendulum,1]": "rad",
        "delta_y[X,pendulum,1]": "rad",
        "delta_z[X,pendulum,1]": "rad",
        "rho1": "rad/m",
        "kT[X]": "1/K",
    }
    assert dict(zip(shown, model.owners, strict=True))["rho1"] == "roll-gravity"
    assert model.owners[:6] == ("",) * 6


def test_the_null_comes_out_in_degrees_with_its_sigma() -> None:
    study = SensingAxisStudy(recording())
    model = study.model([Term("roll-gravity")])
    found = fitted(model)
    shown = study.result(model, found.values, found.covariance)["theta0[X,pendulum,1]"]
    assert shown["unit"] == "deg"
    assert shown["value"] == pytest.approx(0.3, abs=4 * shown["sigma"])
    assert shown["sigma"] == pytest.approx(found.sigma("theta0[X,pendulum,1]"))
    assert 1e-6 < shown["sigma"] < 1e-3
    assert found.value("rho1") == pytest.approx(1e-4, abs=4 * found.sigma("rho1"))


def test_the_jacobian_is_the_slope_of_the_prediction() -> None:
    model = SensingAxisStudy(recording()).model([Term("roll-gravity"), Term("yaw")])
    values = np.array([each.start for each in model.parameters])
    values[0], values[-1] = 0.25, 1e-4
    slopes = model.jacobian(values)
    for i, parameter in enumerate(model.parameters):
        step = np.zeros(len(values))
        step[i] = parameter.step or 1e-6
        slope = (model.predict(values + step) - model.predict(values - step)) / (2 * step[i])
        np.testing.assert_allclose(slopes[:, i], slope, rtol=1e-6, atol=1e-9 * np.abs(slope).max())


def test_a_candidates_derivative_is_that_of_the_model_with_it() -> None:
    study = SensingAxisStudy(recording())
    before = study.model([Term("roll-gravity")])
    values = fitted(before).values
    found, _ = study.candidates(before, values)
    assert {each.term.effect for each in found} >= {"yaw", "time-skew", "null-drift", "laser-cosine"}
    for candidate in found:
        after = study.model([Term("roll-gravity"), candidate.term])
        names = [each.name for each in after.parameters]
        known = dict(zip((each.name for each in before.parameters), values, strict=True))
        slopes = after.jacobian(np.array([known.get(name, 0.0) for name in names]))
        columns = [names.index(name) for name in candidate.names]
        assert tuple(after.units[i] for i in columns) == candidate.units
        assert {after.owners[i] for i in columns} == {candidate.term.effect}
        scale = np.abs(candidate.derivative).max(axis=0)
        np.testing.assert_allclose(slopes[:, columns] / scale, candidate.derivative / scale, atol=1e-6)


def test_a_scanned_head_is_a_candidate_of_its_own_until_it_is_taken() -> None:
    study = SensingAxisStudy(recording())
    heads = ["laser_1_mm", "laser_2_mm", "laser_3_mm"]
    found, _ = candidates_of(study)
    assert [each.term.choice["head"] for each in found["laser-nonlinearity"]] == heads
    assert [each.term.choice["head"] for each in found["laser-crosstalk"]] == ["laser_2_mm"]
    assert found["laser-cosine"][0].names == ("dt[laser_1_mm]",)
    left, _ = candidates_of(study, Term("laser-nonlinearity", {"head": "laser_2_mm"}))
    assert [each.term.choice["head"] for each in left["laser-nonlinearity"]] == ["laser_1_mm", "laser_3_mm"]
    model = study.model([Term("laser-nonlinearity", {"head": head}) for head in heads[1:]])
    assert [each.name for each in model.parameters][-2:] == ["q[laser_2_mm]", "q[laser_3_mm]"]


def test_several_drifts_have_a_rate_each() -> None:
    study = SensingAxisStudy(recording())
    assert study.model([Term("bias-drift")]).parameters[-1].name == "rate[X]"
    names = [each.name for each in study.model([Term("bias-drift"), Term("gain-drift")]).parameters]
    assert names[-2:] == ["gain-drift.rate[X]", "bias-drift.rate[X]"]
    found, _ = candidates_of(study, Term("bias-drift"))
    assert found["gain-drift"][0].names == ("gain-drift.rate[X]",)
    assert found["gain-drift"][0].typical == pytest.approx([1e-8])


def test_the_order_of_terms_is_no_matter() -> None:
    study = SensingAxisStudy(recording())
    one, other = (
        study.model([Term(a), Term(b)]) for a, b in (("resonance", "roll-gravity"), ("roll-gravity", "resonance"))
    )
    assert [each.name for each in one.parameters] == [each.name for each in other.parameters]


@pytest.mark.parametrize(
    ("columns", "effects", "reason"),
    [
        ({"temperature_c": lambda _: math.nan}, ["thermal-bias", "thermal-gain"], "temperature_c was not recorded"),
        ({"temperature_c": lambda _: 21.0}, ["thermal-bias", "thermal-gain"], "same in all runs"),
        ({"temperature_c": lambda i: math.nan if i == 2 else i}, ["thermal-bias"], "missing in 1 of 6 runs"),
        ({"approach": lambda _: 1}, ["cable-hysteresis"], "reached from the same side"),
        ({"approach": lambda _: math.nan}, ["cable-hysteresis"], "approach was not recorded"),
        ({"start_s": lambda _: math.nan}, ["bias-drift", "gain-drift", "null-drift"], "start_s was not recorded"),
    ],
)
def test_without_the_data_an_effect_is_not_testable_and_says_why(
    columns: Mapping[str, Callable[[int], float]], effects: list[str], reason: str
) -> None:
    study = SensingAxisStudy(recording(**columns))  # type: ignore[arg-type]
    found, refused = candidates_of(study)
    for effect in effects:
        assert effect not in found
        assert reason in refused[effect]
        with pytest.raises(DataError, match=f"'{effect}' cannot be in a model"):
            study.model([Term(effect)])
    assert all(np.isfinite(each.derivative).all() for group in found.values() for each in group)


def test_without_heads_there_is_no_cube_to_turn() -> None:
    study = SensingAxisStudy(recording(heads=0))
    found, refused = candidates_of(study)
    assert not any(each.name.startswith("delta") for each in study.model([]).parameters)
    assert {name for name in refused if "no displacement head" in refused[name]} == {
        "laser-cosine",
        "laser-nonlinearity",
        "laser-crosstalk",
    }
    assert "roll-gravity" in found


def test_one_head_leaves_the_rest_of_the_cube_to_the_level() -> None:
    study = SensingAxisStudy(recording(heads=1))
    found = fitted(study.model([Term("roll-gravity")]))
    assert found.verdict == "converged", found.reason
    _, refused = candidates_of(study)
    assert "across the motion" in refused["laser-crosstalk"]


def test_a_head_of_which_nobody_says_where_it_looks_is_left_out() -> None:
    study = SensingAxisStudy(recording(laser_2_face=lambda _: ""))
    assert {each.channel for each in study.model([]).observations.series} == {"accel_v", "laser_1_mm", "laser_3_mm"}


def test_noise_pools_are_one_for_all_means_and_one_for_each_series_of_a_configuration() -> None:
    mountings = [("X", "pendulum", 1), ("Y", "flag", 2)]
    observations = SensingAxisStudy(recording(mountings)).model([]).observations
    means = [pool for pool in observations.pools if pool.dof == 0]
    assert [(pool.name, pool.order) for pool in means] == [("DC", "start_s")]
    assert len(observations.pools) == 1 + 2 * 24
    assert all(pool.dof > 5 and pool.order is None for pool in observations.pools if pool not in means)
    in_means = observations.pool_of == observations.pools.index(means[0])
    assert {observations.series[i].component for i in observations.series_of[in_means]} == {"DC"}
    assert list(observations.group_of[in_means]) == [0] * 6 + [1] * 6
    # Relative weights must not scatter with the noise of the single run.
    assert len(set(observations.sigma[in_means][:6])) == 1


def test_without_times_means_have_no_order() -> None:
    observations = SensingAxisStudy(recording(start_s=lambda _: math.nan)).model([]).observations
    assert next(pool for pool in observations.pools if pool.dof == 0).order is None


def test_blocks_are_mountings_or_else_stretches_of_time() -> None:
    three = [("X", "pendulum", 1), ("X", "flag", 1), ("Y", "flag", 1)]
    assert list(SensingAxisStudy(recording(three)).model([]).observations.block_of) == [0] * 6 + [1] * 6 + [2] * 6
    backwards = recording(start_s=lambda i: -60.0 * i)
    # Runs are in the order of time, whatever their order in the file.
    forwards = SensingAxisStudy(backwards).model([]).observations
    assert list(forwards.run_ids) == [record.run_id for record in reversed(backwards.runs())]
    assert list(forwards.block_of) == [0, 0, 1, 2, 3, 4]
    single = recording(angles=[0.1], frequencies=[0.6])
    assert list(SensingAxisStudy(single).model([]).observations.block_of) == [0]


def test_covariates_are_the_set_points_and_the_laboratorys_own_columns() -> None:
    study = SensingAxisStudy(recording(humidity=lambda i: 0.4 + 0.01 * i))
    observations = study.model([]).observations
    assert (observations.angle, observations.frequency) == ("theta_deg", "frequency_hz")
    assert list(observations.covariates["theta_deg"][:2]) == pytest.approx([-1.0, -1.0])
    assert list(observations.covariates["frequency_hz"][:2]) == pytest.approx([0.3, 0.6])
    assert list(observations.covariates["humidity"]) == pytest.approx([0.4 + 0.01 * i for i in range(6)])
    assert set(observations.covariates) >= {"temperature_c", "start_s", "approach", "mounting"}


def test_the_amplitude_is_a_condition_only_where_it_was_set_differently() -> None:
    alike = recording()
    assert "amplitude_mm" not in SensingAxisStudy(alike).model([]).observations.covariates
    halved = {
        name: {key: column * (0.5 if name == "1" and key != "t_s" else 1.0) for key, column in columns.items()}
        for name, columns in alike.columns.items()
    }
    covariates = SensingAxisStudy(replace(alike, columns=halved)).model([]).observations.covariates
    assert list(covariates["amplitude_mm"]) == pytest.approx([2.5] + [5.0] * 5, rel=1e-6)


def test_a_plugin_is_a_candidate_and_a_term_like_any_other(tmp_path: Path) -> None:
    path = tmp_path / "my_effects.py"
    path.write_text(PLUGIN)
    study = SensingAxisStudy(recording(humidity=lambda i: 0.4 + 0.01 * (i * i % 5)), [load(path)])
    assert study.effects()["humid"] == "Damp makes the bias wander."
    found, _ = candidates_of(study)
    assert found["humid"][0].names == ("bH",)
    assert fitted(study.model([Term("humid")])).verdict == "converged"
    assert "humid" not in SensingAxisStudy(recording()).effects()


def test_a_plugin_whose_column_is_missing_says_which_there_are(tmp_path: Path) -> None:
    path = tmp_path / "my_effects.py"
    path.write_text(PLUGIN)
    study = SensingAxisStudy(recording(pressure_hpa=lambda i: 1000.0 + i), [load(path)])
    _, refused = candidates_of(study)
    assert (
        refused["humid"]
        == "no column 'humidity' of numbers in runs.csv; columns beyond the format's own: pressure_hpa"
    )
    with pytest.raises(DataError, match="'humid' cannot be in a model of this recording: no column 'humidity'"):
        study.model([Term("humid")])
    holes = SensingAxisStudy(recording(humidity=lambda i: math.nan if i else 0.5), [load(path)])
    _, refused = candidates_of(holes)
    assert "humidity unknown" in refused["humid"]


JUMPS = '''\
import numpy as np

from rigctl.effects import effect


@effect("early", on="sensor_output_v", parameters={"jump": "V"}, typical={"jump": 1e-3})
def early(run, jump):
    """The bias jumps after the second run."""
    return np.where(run.start > 100.0, jump, 0.0)


@effect("late", on="sensor_output_v", parameters={"later": "V"}, typical={"later": 1e-3})
def late(run, later):
    """The bias jumps after the last run."""
    return later * (run.start > 1e5)


@effect("twice", on="sensor_output_v", parameters={"one": "V", "two": "V"}, typical={"one": 1.0, "two": 1.0})
def twice(run, one, two):
    """The bias jumps after the second run and after the last."""
    return one * (run.start > 100.0) + two * (run.start > 1e5)


@effect("shelved", on="sensor_output_v", parameters={"shelf": "V"}, typical={"shelf": 1e-3})
def shelved(run, shelf):
    """Each bench its own bias."""
    return shelf * np.array([0.0, 1.0, -1.0])[run.column("bench").astype(int)]
'''


def test_a_jump_counts_where_it_falls_into_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "jumps.py"
    path.write_text(JUMPS)
    study = SensingAxisStudy(recording(bench=lambda i: i % 3), [load(path)])
    found, refused = candidates_of(study)
    assert np.any(found["early"][0].derivative)
    assert np.any(found["twice"][0].derivative[:, 0])
    assert found["shelved"][0].names == ("shelf",)
    assert refused["late"] == "it changes nothing in these runs"
    result = fitted(study.model([Term("early")]))
    assert abs(result.value("jump")) < 5.0 * result.sigma("jump")


def test_a_plugin_that_fails_on_a_recording_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "jumps.py"
    path.write_text(JUMPS)
    study = SensingAxisStudy(recording(bench=lambda i: 7.0), [load(path)])
    _, refused = candidates_of(study)
    assert refused["shelved"].startswith("effect 'shelved' fails, line 27: IndexError: index 7 is out of bounds")
    with pytest.raises(DataError, match="effect 'shelved' fails, line 27: IndexError"):
        study.model([Term("shelved")])


def test_unknown_effects_and_heads_are_named_with_what_they_may_be() -> None:
    study = SensingAxisStudy(recording())
    with pytest.raises(ConfigError, match=r"unknown effect 'warp'; the nearest are .*--plugin FILE"):
        study.model([Term("warp")])
    with pytest.raises(ConfigError, match=r"no head 'laser_9_mm'; there are: laser_1_mm"):
        study.model([Term("laser-cosine", {"head": "laser_9_mm"})])
    with pytest.raises(ConfigError, match="'yaw' is not one of a head"):
        study.model([Term("yaw", {"head": "laser_1_mm"})])


def test_numbers_of_mountings_may_be_used_again_in_other_axes() -> None:
    mountings = [(axis, configuration, 1) for axis in "XY" for configuration in ("pendulum", "flag")]
    model = SensingAxisStudy(recording(mountings, heads=0)).model([Term("roll-gravity")])
    found = fitted(model)
    assert found.verdict == "converged", found.reason
    for axis, configuration, _ in mountings:
        name = f"theta0[{axis},{configuration},1]"
        assert found.value(name) == pytest.approx(THETA0[axis], abs=4 * found.sigma(name))


def test_an_imported_recording_has_no_data_sheet() -> None:
    model = SensingAxisStudy(recording()).model([Term("resonance")])
    resonance = [each for each in model.parameters if each.name.startswith(("inv_w0", "damping"))]
    assert [(each.start, each.prior) for each in resonance] == [(0.0, None)] * 2
    level = next(each for each in model.parameters if each.name.startswith("delta_x"))
    assert level.prior is not None
    assert level.prior.sigma == pytest.approx(15e-3)


def test_our_own_recording_has_its_rig_files_package_heads_and_certificates() -> None:
    text = read_rig(CAMPAIGNS / "isa-rig.toml").text_without_world
    header = replace(recording().header, rig_toml=text)
    model = SensingAxisStudy(recording(header=header)).model([Term("resonance")])
    priors = {each.name: each.prior for each in model.parameters if each.prior is not None}
    assert priors["inv_w0_squared[X,pendulum]"].mean == pytest.approx((2 * math.pi * 4.53) ** -2, rel=1e-3)
    assert {name for name in priors if name.startswith("scale[")} == {f"scale[laser_{n}_mm]" for n in (1, 2, 3)}


def test_a_recording_whose_runs_are_all_invalid_has_nothing_to_fit() -> None:
    empty = recording()
    study = SensingAxisStudy(replace(empty, records=[replace(each, valid=False) for each in empty.records]))
    with pytest.raises(DataError, match="nothing to fit"):
        study.model([])


def test_axes_are_summed_up_where_mountings_suffice() -> None:
    mountings = [("X", c, n) for n, c in enumerate(("pendulum", "flag", "pendulum", "flag"), start=1)]
    rng = np.random.default_rng(2)
    study = SensingAxisStudy(recording(mountings, heads=3))
    model = study.model([Term("roll-gravity")])
    found = fitted(model)
    sizes = np.where([name.startswith("theta0") for name in found.names], 4e-3, 0.0)
    scattered = found.values + sizes * rng.standard_normal(len(sizes))
    shown = study.result(model, scattered, found.covariance)
    assert set(shown) == {*(f"theta0[X,{c},{n}]" for _, c, n in mountings), "std_hc_2sigma[X]"}
    assert shown["std_hc_2sigma[X]"]["unit"] == "arcsec"
    # Two sigma of four angles that scatter by 4e-3 degrees.
    assert 5.0 < shown["std_hc_2sigma[X]"]["value"] < 80.0


DELAY = '''
import numpy as np
from rigctl.effects import effect


@effect("laser-delay", on="laser_m", parameters={"tau": "s"}, typical={"tau": 1e-3})
def laser_delay(run, tau):
    """The heads show what was a moment ago."""
    return run.filtered(lambda s: np.exp(-s * tau)) - run.signal
'''


def on_own_clocks(edges: Recording) -> Recording:
    """The same recording, its heads on clocks of their own."""
    columns = {
        run_id: {**samples, **{f"laser_{n}_mm.t_s": samples["t_s"] + 0.01 for n in (1, 2, 3)}}
        for run_id, samples in edges.columns.items()
    }
    return replace(edges, columns=columns)


def test_what_only_delays_heads_on_their_own_clocks_is_said_to_be_taken_up(tmp_path: Path) -> None:
    path = tmp_path / "my_effects.py"
    path.write_text(DELAY)
    edges = recording()
    found, refused = candidates_of(SensingAxisStudy(edges, [load(path)]))
    assert "laser-delay" in found
    assert "laser-delay" not in refused
    found, refused = candidates_of(SensingAxisStudy(on_own_clocks(edges), [load(path)]))
    assert "laser-delay" not in found
    assert "whose offsets are fitted in every run" in refused["laser-delay"]
    assert {"laser-cosine", "laser-nonlinearity", "time-skew"} <= set(found)


def test_the_quadrature_of_a_head_on_its_own_clock_is_no_observation() -> None:
    edges = recording()
    there, gone = (
        set(SensingAxisStudy(each).model(()).observations.series_of.tolist())
        for each in (edges, on_own_clocks(edges))
    )
    series = SensingAxisStudy(edges).model(()).observations.series
    assert {series[index].name for index in there - gone} == {f"laser_{n}_mm nu quadrature" for n in (1, 2, 3)}
    assert gone < there
