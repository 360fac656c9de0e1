"""What is stated of a recording's instruments: by its rig file, or by what came with a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pydantic import ValidationError

from rigctl.campaign.recording import Header
from rigctl.core.errors import DataError
from rigctl.files.package import HeadSettings
from rigctl.files.rig_file import Certificate, parse_rig

CERTIFICATES, CONSTANTS_U = "certificates", "constants_u"
"""Keys of recording.toml: tables of certificates as a rig file has them, and standard uncertainties of constants."""


class StatedFlaw(DataError):
    """What cannot be stated: `keys` lead to it in recording.toml, `said` is what is wrong and the mend."""

    def __init__(self, keys: tuple[str, ...], said: str) -> None:
        super().__init__(f"{'.'.join(keys)} of the recording {said}")
        self.keys, self.said = keys, said


def certificates_of(header: Header) -> dict[str, Certificate]:
    """By the names of instruments, channels and parts; `StatedFlaw` for one that cannot be."""
    if header.rig_toml is not None:
        return parse_rig(header.rig_toml, Path("rig file")).certificates
    return {name: _certificate(name, each) for name, each in _table(header, CERTIFICATES).items()}


def uncertainties_of(header: Header) -> dict[str, dict[str, float]]:
    """Standard uncertainties of the certificates by name and quantity; those of the constants as "constants".

    `StatedFlaw` for one that is no number, or negative.
    """
    if header.rig_toml is not None:
        return parse_rig(header.rig_toml, Path("rig file")).uncertainties
    certified = {name: dict(each.uncertainty) for name, each in certificates_of(header).items()}
    return {**certified, "constants": {name: _u(name, value) for name, value in _table(header, CONSTANTS_U).items()}}


def heads_of(header: Header) -> dict[str, HeadSettings]:
    """The displacement heads by column, with what certificates say of them.

    Without a rig file it is not known where they stand: that follows from the face each looks at, run by run.
    """
    if header.rig_toml is not None:
        return parse_rig(header.rig_toml, Path("rig file")).heads
    known = uncertainties_of(header)
    heads = {name: HeadSettings(position="+x", tilt_deg=each.tilt_deg or 0.0) for name, each in header.lasers.items()}
    return {name: head.certified(known.get(name)) for name, head in heads.items()}


def _table(header: Header, key: str) -> Mapping[str, object]:
    found = header.extra.get(key, {})
    if not isinstance(found, dict):
        raise StatedFlaw((key,), f"is no table; write [{key}] or [{key}.NAME]")
    return found


def _certificate(name: str, stated: object) -> Certificate:
    try:
        return Certificate.model_validate(stated)
    except ValidationError as error:
        first = error.errors()[0]
        keys = (CERTIFICATES, name, *map(str, first["loc"]))
        raise StatedFlaw(keys, f"cannot be: {first['msg'].lower()}; write it as in a rig file") from None


def _u(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < float("inf"):
        raise StatedFlaw((CONSTANTS_U, name), f"is {value!r}; write a standard uncertainty, no less than 0")
    return float(value)
