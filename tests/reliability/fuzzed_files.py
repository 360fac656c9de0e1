"""Every kind of file that is read, spoilt by seed: bundles, tables, rig and campaign files, files of effects.

A valid file is made anew for each trial, spoilt once to three times, and read. It is then read whole and written
again without loss, or refused by one typed error in one printable line.
"""

from __future__ import annotations

import csv
import gc
import gzip
import io
import json
import os
import random
import sys
import traceback
import warnings
import zipfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from rigctl.campaign.bundle.bundle import import_bundle, read_bundle, write_bundle
from rigctl.campaign.recording import RunSource
from rigctl.core.errors import ConfigError, DataError, PluginError, RigError
from rigctl.effects import plugins
from rigctl.experiments.table.study import TableStudy
from rigctl.files.campaign_file import read_campaign
from rigctl.files.rig_file import read_rig
from tests.reliability.valid_files import ODD_TEXT, ODD_TOML, Bundle, bundles, effects, shipped

PROMISE = (
    "Whatever a file holds, it is read and written again without loss, or refused in one line, and nothing grows"
)

FILES = 500
STORED = 0.1
GROWTH_MB = 64.0
LINE_CHARACTERS = 1500
NEVER_RUN = (SystemExit, KeyboardInterrupt, GeneratorExit)


def trial(seed: int, work: Path) -> dict[str, Any]:
    """Some hundred files of every kind, spoilt."""
    draw = random.Random(seed)
    before_mb = _resident_mb()
    failures: list[str] = []
    refused = 0
    for number in range(FILES):
        kind = draw.choice(list(KINDS))
        spoilt, text = KINDS[kind](draw)
        place = work / "now"
        try:
            refused += _refused(place, spoilt, text, draw)
        except (Exception, *NEVER_RUN) as error:  # noqa: BLE001 - this is what is looked for
            said = f"{kind}, file {number}: {type(error).__name__}: {error}"[:500]
            failures.append(f"{said}\n{traceback.format_exc()}")
            place.rename(work / f"kept-{number}")
        _remove(place)
    gc.collect()
    grown_mb = _resident_mb() - before_mb
    if grown_mb > GROWTH_MB:
        failures.append(f"grown by {grown_mb:.0f} MB")
    if refused in {0, FILES}:
        failures.append(f"{refused} of {FILES} files were refused")
    if failures:
        (work / "failures.txt").write_text("\n\n".join(failures), encoding="utf-8")
    return {
        "tried": FILES,
        "refused": refused,
        "grown_mb": round(grown_mb, 1),
        "failures": len(failures),
        "failed": failures[0].splitlines()[0] if failures else "",
    }


Read = Callable[[Path], None]


def _refused(place: Path, files: Bundle, read: Read, draw: random.Random) -> bool:
    """Whether the files were refused; `AssertionError` for a refusal that is not one printable line."""
    place.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(data)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            read(place)
            if read is _read_bundle and draw.random() < STORED:
                _store(place)
    except (ConfigError, DataError, PluginError) as error:
        said = str(error)
        assert said.isprintable(), f"not one line: {said!r}"
        assert len(said) < LINE_CHARACTERS, f"{len(said)} characters: {said[:200]}"
        return True
    return False


def _read_bundle(place: Path) -> None:
    whole = read_bundle(place / "b.zip" if (place / "b.zip").exists() else place)
    write_bundle(whole, place / "again")
    assert _held(whole) == _held(read_bundle(place / "again")), "another recording came back"


def _store(place: Path) -> None:
    path = place / "b.zip" if (place / "b.zip").exists() else place
    with import_bundle(path, place / "s.rig.sqlite") as store:
        assert _held(store) == _held(read_bundle(path)), "another recording was stored"


def _read_table(place: Path) -> None:
    _read_bundle(place)
    try:
        TableStudy(read_bundle(place)).model(())
    except RigError as error:
        raise DataError(str(error)) from error


def _held(source: RunSource) -> tuple[object, ...]:
    """All that a recording holds, so that NaN equals NaN; what is remarked on at import is not part of it."""
    runs = [
        (run.run_id, run.valid, repr(sorted(run.conditions.items())), _bits(source.samples(run.run_id)))
        for run in source.runs()
    ]
    return json.dumps(asdict(source.header), sort_keys=True), runs


def _bits(columns: dict[str, Any]) -> dict[str, bytes]:
    return {name: np.where(np.isnan(c), np.nan, c).tobytes() for name, c in columns.items()}


def _read_rig(place: Path) -> None:
    read_rig(place / "rig.toml")


def _read_campaign(place: Path) -> None:
    read_campaign(place / "campaign.toml")


def _read_effects(place: Path) -> None:
    """As `plugins.load` does after the trial in another process, which would take a tenth of a second each."""
    path = place / "effects.py"
    for each in plugins.effects_of(plugins.executed(path, path.read_bytes())):
        if flaw := plugins.flaw_of_declaration(each) or plugins._flaw_of_trial(each, path):
            raise ConfigError(plugins.one_line(f"{path}: {flaw}"))


def _spoilt_bundle(draw: random.Random) -> tuple[Bundle, Read]:
    files = dict(draw.choice(bundles()))
    read = _read_table if "readings.csv" in files else _read_bundle
    for _ in range(draw.randint(1, 3)):
        name = draw.choice(list(files))
        files[name] = _spoilt(name, files[name], draw)
    if "runs/2.csv" in files and draw.random() < 0.3:
        _packed_run(files, draw)
    if draw.random() < 0.15:
        files, read = {"b.zip": _zipped(files, draw)}, _read_bundle
    return files, read


def _packed_run(files: Bundle, draw: random.Random) -> None:
    """One run as .csv.gz or .npz, whole or with some bytes changed."""
    text = files.pop("runs/2.csv")
    if draw.random() < 0.5:
        name, data = "runs/2.csv.gz", gzip.compress(text)
    else:
        name, data = "runs/2.npz", _npz(draw)
    files[name] = _other_bytes(data, draw) if draw.random() < 0.7 else data


def _npz(draw: random.Random) -> bytes:
    arrays: dict[str, Any] = {"t_s": np.arange(40) * 0.1, "stage_x_mm": np.zeros(40), "accel_v": np.ones(40)}
    arrays[draw.choice(list(arrays))] = draw.choice(
        [np.ones(39), np.ones((4, 10)), np.array([None]), np.array(["a"]), np.full(40, np.inf), np.ones(40, complex)]
    )
    data = io.BytesIO()
    np.savez_compressed(data, **arrays)
    return data.getvalue()


def _zipped(files: Bundle, draw: random.Random) -> bytes:
    data = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        warnings.simplefilter("ignore")
        for name, content in files.items():
            archive.writestr(draw.choice(["", "", "", "", "", "../", "/"]) + name, content)
        if draw.random() < 0.2:
            archive.writestr(draw.choice(list(files)), b"twice")
    return _other_bytes(data.getvalue(), draw) if draw.random() < 0.6 else data.getvalue()


def _spoilt_rig(draw: random.Random) -> tuple[Bundle, Read]:
    return {"rig.toml": _spoilt("rig.toml", draw.choice(shipped("*rig.toml")), draw)}, _read_rig


def _spoilt_campaign(draw: random.Random) -> tuple[Bundle, Read]:
    return {"campaign.toml": _spoilt("campaign.toml", draw.choice(shipped("*.toml")), draw)}, _read_campaign


def _spoilt_effects(draw: random.Random) -> tuple[Bundle, Read]:
    return {"effects.py": _spoilt("effects.py", draw.choice(effects()), draw)}, _read_effects


KINDS: dict[str, Callable[[random.Random], tuple[Bundle, Read]]] = {
    "bundle": _spoilt_bundle,
    "another bundle": _spoilt_bundle,
    "a third bundle": _spoilt_bundle,
    "rig file": _spoilt_rig,
    "campaign file": _spoilt_campaign,
    "file of effects": _spoilt_effects,
}


def _spoilt(name: str, data: bytes, draw: random.Random) -> bytes:
    """One change: by bytes, or by what the file is made of."""
    if draw.random() < 0.3:
        return _other_bytes(data, draw)
    try:
        text = data.decode()
    except UnicodeDecodeError:
        return _other_bytes(data, draw)
    if name.endswith(".csv"):
        return _other_fields(text, draw).encode(draw.choice(["utf-8"] * 8 + ["utf-16", "latin-1"]), "replace")
    if name.endswith(".toml"):
        return _other_lines(text, draw, ODD_TOML).encode("utf-8", "replace")
    return _other_lines(
        text, draw, ("raise SystemExit", "import sys; sys.exit(0)", "    return None", "(" * 300, "x =")
    ).encode("utf-8", "replace")


def _other_bytes(data: bytes, draw: random.Random) -> bytes:
    place = draw.randrange(len(data) + 1)
    end = min(len(data), place + draw.randrange(1, 200))
    match draw.randrange(6):
        case 0:
            return data[:place]
        case 1:
            return data[:place] + data[end:]
        case 2:
            return data[:end] + data[place:]
        case 3:
            return data[:place] + draw.randbytes(draw.randrange(20)) + data[place:]
        case 4:
            return b"" if draw.random() < 0.2 else data + data
        case _:
            spoilt = bytearray(data or b"?")
            for _ in range(draw.randint(1, 4)):
                spoilt[draw.randrange(len(spoilt))] ^= 1 << draw.randrange(8)
            return bytes(spoilt)


def _other_fields(text: str, draw: random.Random) -> str:
    rows = [line.split(",") for line in text.splitlines()]
    if len(rows) < 2:
        return text + draw.choice(ODD_TEXT)
    row = draw.randrange(len(rows))
    column = draw.randrange(max(len(rows[row]), 1))
    match draw.randrange(8):
        case 0 | 1 | 2:
            rows[row][column : column + 1] = [draw.choice(ODD_TEXT)]
        case 3:
            for each in rows[1:]:
                each[column : column + 1] = [draw.choice(ODD_TEXT)]
        case 4:
            rows[0][:] = draw.sample(rows[0], len(rows[0]))
        case 5:
            rows[row:row] = [rows[row]]
        case 6:
            del rows[row]
        case _:
            factor = draw.choice([1e3, 1e-3, -1.0, 1e30, 1e-30, 0.0])
            for each in rows[1:]:
                each[column : column + 1] = [_times(each[column], factor)] if column < len(each) else []
    written = io.StringIO()
    csv.writer(written, lineterminator=draw.choice(["\n", "\n", "\r\n", "\r"])).writerows(rows)
    return written.getvalue()


def _times(field: str, factor: float) -> str:
    try:
        return repr(float(field) * factor)
    except ValueError:
        return field


def _other_lines(text: str, draw: random.Random, odd: tuple[str, ...]) -> str:
    lines = text.split("\n")
    place = draw.randrange(len(lines))
    match draw.randrange(6):
        case 0 | 1:
            lines[place:place] = [draw.choice(odd)]
        case 2:
            del lines[place]
        case 3:
            lines[place:place] = [lines[draw.randrange(len(lines))]]
        case 4:
            key, mark, _ = lines[place].partition("=")
            lines[place] = f"{key}{mark} {draw.choice(odd).partition('=')[2] or draw.choice(ODD_TEXT)}"
        case _:
            key, mark, value = lines[place].partition("=")
            lines[place] = f"{draw.choice(ODD_TEXT)}{mark}{value}"
    return "\n".join(lines)


def _remove(place: Path) -> None:
    for path in sorted(place.rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    if place.exists():
        place.rmdir()


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1]) if sys.platform == "linux" else 0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
