"""What is printed and drawn of a tumble test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rigctl.core.arrays import FloatArray
from rigctl.report.drawn import Drawn
from rigctl.report.figures.data import Plate
from rigctl.report.quantities import quantity
from rigctl.report.tables.result_table import ResultTable
from rigctl.workbench.study_base import own_model
from rigctl.workbench.workbench import Workbench
from tumble_test.model import TumbleModel
from tumble_test.positions import AXES
from tumble_test.study import G_N, result


@dataclass(frozen=True)
class Deviation:
    """One position of one sensor: what it puts out beyond bias, scale factor and misalignment, and the model's."""

    sensor: str
    mounting: str
    angle_deg: float
    measured_ug: float
    model_ug: float


def draw(workbench: Workbench, lines_hz: Sequence[float], found: Sequence[Any]) -> Drawn:
    """The coefficients, and what is curved in the outputs."""
    del lines_hz, found
    told = result(workbench)
    model = own_model(workbench.study.model(workbench.current.terms), TumbleModel)
    values = [told["parameters"].get(each.name, {"value": each.start})["value"] for each in model.parameters]
    return Drawn(told, [nonlinearity_plate(model, np.array(values))])


def tables(found: Mapping[str, Any], reference: Mapping[str, Any]) -> list[ResultTable]:
    """The coefficients, a row for each and a column for each sensor."""
    del reference
    by_name: dict[str, dict[str, str]] = {}
    for name, each in found["result"].items():
        plain, _, sensor = name.rstrip("]").partition("[")
        by_name.setdefault(plain, {})[sensor] = quantity(each["value"], each["sigma"], each["unit"])
    sensors = [name for name in AXES if any(name in row for row in by_name.values())]
    rows = [[name, *(row.get(sensor, "not determined") for sensor in sensors)] for name, row in by_name.items()]
    words = "Coefficients of the model equation; g is 9.80665 m/s2."
    return [ResultTable(words, ["coefficient", *(f"#{sensor}" for sensor in sensors)], rows)]


def nonlinearity_plate(model: TumbleModel, values: FloatArray) -> Plate[Deviation]:
    """Output less bias, scale factor and misalignment against the angle: what is curved in it."""
    data = model.data
    straight, count = values[: model.own].copy(), len(data.sensors)
    straight[4 * count : 8 * count] = 0.0
    line_v = TumbleModel(data, held=model.held).predict(straight)
    per_ug = values[:count][data.place] * G_N * 1e-6
    measured = (data.observations.value - line_v) / per_ug
    modelled = (model.predict(values) - line_v) / per_ug
    columns = zip(data.place, data.seat_of, np.rad2deg(data.run.theta), measured, modelled, strict=True)
    seats = [f"{out} out, {clocking_deg:g} deg" for out, clocking_deg, _ in data.seats]
    rows = [Deviation(data.sensors[place], seats[seat], *map(float, numbers)) for place, seat, *numbers in columns]
    caption = "What each sensor puts out beyond bias, scale factor and misalignment (points), and the model (lines)."
    return Plate("tumble_nonlinearity", caption, rows, _drawn)


def _drawn(rows: Sequence[Deviation]) -> Figure:
    sensors = list(dict.fromkeys(row.sensor for row in rows))
    figure = Figure(figsize=(7.0, 2.4 * len(sensors)), layout="constrained")
    for axes, sensor in zip(figure.subplots(len(sensors), squeeze=False)[:, 0], sensors, strict=True):
        for mounting in dict.fromkeys(row.mounting for row in rows if row.sensor == sensor):
            own = sorted((r for r in rows if (r.sensor, r.mounting) == (sensor, mounting)), key=lambda r: r.angle_deg)
            angles = [row.angle_deg for row in own]
            (points,) = axes.plot(angles, [row.measured_ug for row in own], "o", markersize=3, label=mounting)
            axes.plot(angles, [row.model_ug for row in own], color=points.get_color(), linewidth=0.8)
        axes.set(ylabel=f"{sensor} [µg]", xlabel="angle of the head [deg]")
        axes.legend(fontsize="x-small", ncols=4)
    return figure
