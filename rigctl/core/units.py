"""Which unit the name of a column promises."""

from __future__ import annotations

_BY_SUFFIX = {
    "v_per_m_s2": "V/(m/s2)",
    "rad_s2": "rad/s2",
    "deg_s": "deg/s",
    "rad_s": "rad/s",
    "mm_s": "mm/s",
    "m_s2": "m/s2",
    "m_s3": "m/s3",
    "m_s": "m/s",
    "arcsec": "arcsec",
    "mrad": "mrad",
    "urad": "urad",
    "deg": "deg",
    "rad": "rad",
    "mhz": "mHz",
    "khz": "kHz",
    "hz": "Hz",
    "hpa": "hPa",
    "kpa": "kPa",
    "mbar": "mbar",
    "pa": "Pa",
    "ms": "ms",
    "us": "us",
    "mv": "mV",
    "uv": "uV",
    "nm": "nm",
    "um": "um",
    "mm": "mm",
    "cm": "cm",
    "v": "V",
    "m": "m",
    "s": "s",
    "c": "degC",
    "k": "K",
}

_SPELLINGS = {
    "°c": "degc",
    "℃": "degc",
    "c": "degc",
    "celsius": "degc",
    "deg c": "degc",
    "kelvin": "k",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "volt": "v",
    "volts": "v",
    "metre": "m",
    "meter": "m",
    "second": "s",
    "seconds": "s",
    "hertz": "hz",
    "m/s^2": "m/s2",
    "m/s²": "m/s2",
    "m/s**2": "m/s2",
    "m s-2": "m/s2",
    "rad/s^2": "rad/s2",
    "rad/s²": "rad/s2",
    "µm": "um",
    "μm": "um",
    "µv": "uv",
    "μv": "uv",
    "v/(m/s^2)": "v/(m/s2)",
    "v s2/m": "v/(m/s2)",
}


def unit_of_column(name: str) -> str:
    """The unit the suffix of `name` gives, "" without one.

    `_c` and `_k` are units of temperatures only: a third sensor may well be `sensor_c`.
    """
    for suffix, unit in _BY_SUFFIX.items():
        if name.endswith(f"_{suffix}"):
            return unit if suffix not in {"c", "k"} or name.startswith(("temp", "t_")) else ""
    return ""


def same_unit(one: str, other: str) -> bool:
    """True for two spellings of the same unit; upper and lower case are the same."""
    return _canonical(one) == _canonical(other)


def _canonical(unit: str) -> str:
    text = unit.strip().lower()
    return _SPELLINGS.get(text, text)
