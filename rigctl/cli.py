"""The command line: thin, every command calls what Python users call.

Exit status: 0 done; 1 the work failed; 2 wrong usage or bad input; 130 aborted by the operator.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from rigctl.errors import Aborted, ConfigError, DataError, LimitError, RigError

app = typer.Typer(
    help="Instrument control and model building for precision accelerometer calibration.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

# The matrices here are small: a second thread only waits, and the other core belongs to the console.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

TRACEBACK = "RIGCTL_TRACEBACK"
"""Environment variable for whoever hunts a bug of ours: show it in full."""

Json = Annotated[bool, typer.Option("--json", help="Print one JSON document on stdout.")]
StoreFile = Annotated[Path, typer.Argument(metavar="STORE", help="A campaign file, by convention *.rig.sqlite.")]
RigToml = Annotated[Path, typer.Argument(metavar="RIG.toml", help="A rig file.")]
CampaignToml = Annotated[Path, typer.Argument(metavar="CAMPAIGN.toml", help="A campaign file.")]


def main() -> None:
    """Run a command; errors become one line on stderr and an exit status."""
    try:
        app(standalone_mode=True)
    except RigError as error:
        _fail("; ".join([_said(error), *getattr(error, "__notes__", [])]), _status(error))
    except KeyboardInterrupt:
        _fail("aborted: interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
    except OSError as error:
        _fail(f"{error.filename or 'rigctl'}: {error.strerror or error}; check the path and its permissions", 1)
    except Exception as error:
        if TRACEBACK in os.environ:
            raise
        told = f"{type(error).__name__}: {error}"
        _fail(f"internal error: {told}; please report it with what {TRACEBACK}=1 shows", 1)


def _said(error: RigError) -> str:
    return f"aborted: {error}" if isinstance(error, Aborted) else str(error)


def _status(error: RigError) -> int:
    if isinstance(error, Aborted):
        return 130
    return 2 if isinstance(error, ConfigError | DataError | LimitError) else 1


def _fail(message: str, status: int) -> NoReturn:
    print(" ".join(message.split()), file=sys.stderr)  # noqa: T201
    sys.exit(status)


def _print_json(document: object) -> None:
    print(json.dumps(document, allow_nan=False, default=str))  # noqa: T201


def _say(text: str) -> None:
    print(text)  # noqa: T201


@app.command()
def run(
    campaign: CampaignToml,
    rig: Annotated[Path | None, typer.Option(metavar="RIG.toml", help="Use this rig instead.")] = None,
    store: Annotated[Path | None, typer.Option(help="Where to keep everything; default NAME.rig.sqlite.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed of a simulated world.")] = None,
    yes: Annotated[bool, typer.Option("--yes", help="The simulated operator answers.")] = False,
    dry: Annotated[bool, typer.Option("--dry-run", help="Check and tell what would be done.")] = False,
    as_json: Json = False,
) -> None:
    """Run a campaign from start to result."""
    from rigctl import config, runner

    campaign_file = config.read_campaign(campaign)
    if rig is None and not campaign_file.rig:
        raise ConfigError(f"{campaign}: rig is missing; name the rig file or pass --rig")
    rig_file = config.read_rig(rig or campaign_file.rig_path)
    if dry:
        plan = runner.dry_run(campaign_file, rig_file)
        if as_json:
            _print_json(plan)
        else:
            for key, value in plan.items():
                _say(f"{key}: {', '.join(map(str, value)) if isinstance(value, list) else value}")
        return
    path = store or Path(campaign.stem + ".rig.sqlite")
    from rigctl.report.terminal import ProgressBar

    with ProgressBar() as bar:
        runner.start(campaign_file, rig_file, path, runner.Options(unattended=yes, seed=seed, display=bar))
    _show_outcome(path, as_json=as_json)


@app.command()
def resume(
    store: StoreFile,
    yes: Annotated[bool, typer.Option("--yes", help="The simulated operator answers.")] = False,
    as_json: Json = False,
) -> None:
    """Go on with a paused or an interrupted campaign."""
    from rigctl import runner
    from rigctl.campaign.locks import is_held, store_lock
    from rigctl.campaign.store import Store

    if is_held(store_lock(store)):
        _request(store, "resume", as_json=as_json)
        return
    with Store.open(store, readonly=True) as opened:
        unattended = yes or bool(opened.header.extra.get("unattended"))
    from rigctl.report.terminal import ProgressBar

    with ProgressBar() as bar:
        runner.resume(store, runner.Options(unattended=unattended, display=bar))
    _show_outcome(store, as_json=as_json)


@app.command()
def pause(store: StoreFile, as_json: Json = False) -> None:
    """Ask a running campaign to hold after the run it is in."""
    _request(store, "pause", as_json=as_json)


@app.command()
def abort(store: StoreFile, as_json: Json = False) -> None:
    """Stop a running campaign now; what is recorded stays and can be resumed."""
    _request(store, "abort", as_json=as_json)


def _request(store: Path, kind: str, *, as_json: bool) -> None:
    from rigctl.campaign.locks import is_held, store_lock
    from rigctl.campaign.store import Store

    with Store.open(store) as opened:
        if not is_held(store_lock(store)):
            raise RigError(f"{store}: no campaign is running on it; `rigctl status` tells how it ended")
        opened.add_request(kind)
    if as_json:
        _print_json({"requested": kind})
    else:
        _say(f"asked the campaign to {kind}")


@app.command()
def status(store: StoreFile, as_json: Json = False) -> None:
    """How far a campaign is."""
    from rigctl.campaign.status import status_of

    found = status_of(store)
    if as_json:
        _print_json(found)
    else:
        from rigctl.report.terminal import print_status

        print_status(found)


@app.command()
def result(store: StoreFile, as_json: Json = False) -> None:
    """The sensing axes, the angles between them and their uncertainty."""
    _show_result(store, as_json=as_json)


def _show_outcome(store: Path, *, as_json: bool) -> None:
    from rigctl import results
    from rigctl.campaign.status import status_of

    found = results.of(store)
    if as_json:
        _print_json({"store": str(store), "status": status_of(store), "result": found})
        return
    results.show(store, {**found, "budget": {}})
    more = f"; `rigctl result {store}` shows the uncertainty budget, `rigctl report` the figures"
    _say(f"store: {store}{more if found['axes'] else ''}")


def _show_result(store: Path, *, as_json: bool) -> None:
    from rigctl import results

    found = results.of(store)
    if as_json:
        _print_json(found)
    else:
        results.show(store, found)


@app.command()
def mark(
    store: StoreFile,
    run_id: Annotated[str, typer.Argument(metavar="RUN")],
    reason: Annotated[str, typer.Argument(metavar="REASON")],
    valid: Annotated[bool, typer.Option("--valid/--invalid", help="Use the run, or leave it out.")],
    as_json: Json = False,
) -> None:
    """Declare a run valid or invalid, with the reason."""
    from rigctl.campaign.store import Store

    with Store.open(store) as opened:
        opened.mark(run_id, valid, reason)
    if as_json:
        _print_json({"run_id": run_id, "valid": valid, "reason": reason})
    else:
        _say(f"run {run_id} is {'valid' if valid else 'invalid'}: {reason}")


@app.command("import")
def import_(
    bundle: Annotated[Path, typer.Argument(metavar="BUNDLE", help="A bundle: a directory or a .zip of one.")],
    store: Annotated[Path, typer.Option(help="The store to make.")],
    as_json: Json = False,
) -> None:
    """Read a recording, ours or another laboratory's, into a store."""
    from rigctl.campaign.bundle import import_bundle, import_report
    from rigctl.campaign.recording import ImportReport

    with import_bundle(bundle, store) as imported:
        report = import_report(imported) or ImportReport(len(imported.runs()))
    if as_json:
        _print_json({"runs": report.runs, "invalid": dict(report.invalid), "warnings": list(report.warnings)})
        return
    _say(f"{report.runs} runs read into {store}, {len(report.invalid)} of them invalid")
    for run_id, why in report.invalid:
        _say(f"run {run_id} invalid: {why}")
    for warning in report.warnings:
        _say(f"warning: {warning}")


@app.command()
def export(
    store: StoreFile,
    directory: Annotated[Path, typer.Argument(metavar="DIR")],
    format_: Annotated[str, typer.Option("--format", help="bundle or hdf5")] = "bundle",
    salvage: Annotated[bool, typer.Option("--salvage", help="Include runs that were cut off.")] = False,
    as_json: Json = False,
) -> None:
    """Write a store as a bundle of plain files, or as one HDF5 file in DIR."""
    from rigctl.campaign.store import Store

    if format_ not in {"bundle", "hdf5"}:
        raise ConfigError(f"--format {format_} is unknown; bundle or hdf5")
    written = directory
    lost: tuple[str, ...] = ()
    with Store.open(store, readonly=True, salvage=salvage) as opened:
        if format_ == "hdf5":
            from rigctl.campaign.hdf5 import write_hdf5

            directory.mkdir(parents=True, exist_ok=True)
            written = directory / f"{store.stem}.h5"
            write_hdf5(opened, written)
        else:
            from rigctl.campaign.bundle import write_bundle

            lost = write_bundle(opened, directory, salvage=salvage)
    for line in lost:
        print(line, file=sys.stderr)  # noqa: T201
    if as_json:
        _print_json({"written": str(written), "lost": list(lost)})
    else:
        _say(f"written: {written}")


@app.command()
def report(
    store: StoreFile,
    figures: Annotated[Path | None, typer.Option(metavar="DIR", help="One SVG and one CSV per figure.")] = None,
    as_json: Json = False,
) -> None:
    """Write the figures of a campaign."""
    if figures is None:
        raise ConfigError("nothing to write: pass --figures DIR")
    from rigctl import results

    written = [str(path) for path in results.figures(store, figures)]
    if as_json:
        _print_json({"written": written})
    else:
        _say("\n".join(written))


@app.command()
def simulate(
    rig: RigToml,
    write_rig: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a rig file that points at the served instruments.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Serve a rig file's simulated instruments on loopback ports and pseudo-terminals until interrupted."""
    from rigctl import config
    from rigctl.serving import Served

    with Served(config.read_rig(rig)) as served:
        if write_rig is not None:
            # Whole or not at all: somebody may be waiting for it to appear.
            partial = write_rig.with_name(f".{write_rig.name}.{os.getpid()}")
            partial.write_text(served.rig_text(), encoding="utf-8")
            partial.rename(write_rig)
        if as_json:
            _print_json({"instruments": served.addresses})
        else:
            for address in served.addresses:
                _say(" ".join(f"{key}={value}" for key, value in address.items()))
        sys.stdout.flush()
        served.serve()


@app.command()
def check(rig: RigToml, as_json: Json = False) -> None:
    """Connect to every instrument and ask who it is; moves nothing."""
    from dataclasses import asdict

    from rigctl import config
    from rigctl.rig import Rig

    opened = Rig(config.read_rig(rig))
    opened.open()
    try:
        identities = {name: asdict(identity) for name, identity in opened.identities().items()}
    finally:
        opened.close()
    if as_json:
        _print_json({"instruments": identities})
    else:
        for name, identity in identities.items():
            _say(f"{name}: {identity['model']}, serial {identity['serial'] or '?'}, {identity['text']}")


@app.command()
def stop(rig: RigToml, as_json: Json = False) -> None:
    """Bring every instrument of a rig to rest, whoever is using it."""
    from rigctl import config
    from rigctl.rig import Rig

    opened = Rig(config.read_rig(rig))
    opened.open()
    try:
        opened.stop()
    finally:
        opened.close()
    if as_json:
        _print_json({"stopped": sorted(opened.instruments)})
    else:
        _say(f"at rest: {', '.join(opened.instruments)}")


@app.command()
def home(
    rig: RigToml,
    name: Annotated[str | None, typer.Argument(metavar="NAME")] = None,
    as_json: Json = False,
) -> None:
    """Home a stage, or all of them."""
    with _stages(rig) as stages:
        chosen = [_stage(stages, name, rig)] if name else list(stages.values())
        for stage in chosen:
            stage.home()
        homed = [stage.name for stage in chosen]
    if as_json:
        _print_json({"homed": homed})
    else:
        _say(f"homed: {', '.join(homed)}")


@app.command(context_settings={"ignore_unknown_options": True})
def move(
    rig: RigToml,
    name: Annotated[str, typer.Argument(metavar="NAME")],
    value: Annotated[float, typer.Argument(metavar="VALUE", help="deg for a rotation stage, mm for a linear one")],
    as_json: Json = False,
) -> None:
    """Move a stage to a position (homing it first if needed)."""
    with _stages(rig) as stages:
        stage = _stage(stages, name, rig)
        stage.home()
        stage.move_to(value)
        reading = stage.angle() if hasattr(stage, "angle") else stage.position()
    if as_json:
        _print_json({"name": name, "value": reading.value, "unit": reading.unit})
    else:
        _say(f"{name}: {reading.value:g} {reading.unit}")


def _stages(rig: Path) -> Any:
    from contextlib import contextmanager

    from rigctl import config
    from rigctl.rig import Rig
    from rigctl.runner import rig_of_ones_own

    @contextmanager
    def opened() -> Any:
        file = config.read_rig(rig)
        with rig_of_ones_own(file), Rig(file) as live:
            yield {s.name: s for s in (*live.by_role("rotation"), *live.by_role("linear"))}

    return opened()


def _stage(stages: dict[str, Any], name: str, rig: Path) -> Any:
    if name not in stages:
        raise ConfigError(f"{rig}: no stage '{name}'; there are {', '.join(stages) or 'none'}")
    return stages[name]


if __name__ == "__main__":
    main()
