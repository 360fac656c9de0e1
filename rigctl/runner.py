"""Runs a campaign from start or from where it was interrupted, and leaves the rig safe whatever happens."""

from __future__ import annotations

import importlib.metadata
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from procedures.campaigns import Plan, Work, campaigns_of, plan_of
from rigctl.campaign.item import ITEM, item_of
from rigctl.campaign.layout import layout_of
from rigctl.campaign.origin import rig_file_of, truth_path
from rigctl.campaign.recording import Header
from rigctl.campaign.session import locks, rig_time
from rigctl.campaign.session.control import Control, RequestWatcher, forget_requests
from rigctl.campaign.session.heartbeat import beat
from rigctl.campaign.session.operator import Operator, TerminalOperator, TypedLines
from rigctl.campaign.session.progress import Display, Progress
from rigctl.campaign.session.questions import Questions
from rigctl.campaign.session.session import Session
from rigctl.campaign.store.entries import RESUMED
from rigctl.campaign.store.parts import PLUGINS, Part, Plugins, begin_part, next_part, parts_of
from rigctl.campaign.store.store import Store
from rigctl.charge import in_charge
from rigctl.check.required import clearance_of, informed
from rigctl.core.errors import Aborted, ConfigError, DataError, LimitError, ProcedureError, RigError, refuses_input
from rigctl.core.whole_file import writing
from rigctl.core.workers import Workers
from rigctl.effects.catalogue import chosen
from rigctl.effects.plugins import Plugin, load
from rigctl.files.campaign_file import CampaignFile, parse_campaign
from rigctl.files.rig_file import RigFile, only_tables
from rigctl.rig import Rig
from rigctl.workbench.model import versions as model_versions

VERSIONED = ("rigctl", "numpy", "scipy", "pydantic")


@dataclass(frozen=True)
class Options:
    """How a campaign is run, beyond its files; `plugins` are files with effects of one's own.

    `wire_log` is the directory to log the instruments' wires to, in place of the rig file's; `unchecked` starts also
    with real instruments of which there is no record of a check; `workers` do the work of a study, in place of the
    campaign file's.
    """

    unattended: bool = False
    seed: int | None = None
    display: Display | None = None
    plugins: tuple[Path, ...] = ()
    wire_log: Path | None = None
    unchecked: bool = False
    workers: Workers | None = None


def start(campaign: CampaignFile, rig_file: RigFile, store_path: Path, options: Options) -> None:
    """Run a campaign into a new store; everything is checked before anything is connected, let alone moves."""
    plugins = [load(path) for path in options.plugins]
    plan = _plan(campaign, None, plugins, options.workers)
    clearance = clearance_of(rig_file, unchecked=options.unchecked)
    # Made and planned for before the store exists: a plan that the rig refuses leaves nothing behind.
    rig = Rig(clearance.informed().with_wire_log(options.wire_log), seed=options.seed)
    work = _work(plan, rig, campaign)
    if store_path.exists():
        raise DataError(f"{store_path} exists already; `rigctl resume` it, or choose another --store")
    clearance.require()
    with in_charge(rig, campaign.on_terminal_lost, work.rest) as control:
        # Who answers is asked before there is a store: a rig that does not answer leaves none.
        identities = rig.identities()
        clearance.require_same(identities)
        with _store_to_oneself(store_path):
            # Before the store: one without its world could never be resumed.
            _write_truth(rig_file, store_path)
            brought = _brought(campaign, plugins)
            kept = {**plan.kept(), **({PLUGINS: brought} if brought else {}), **clearance.kept()}
            header = header_of(campaign, rig, options, kept)
            with Store.create(store_path, header) as store:
                for name, identity in identities.items():
                    store.set_identity(name, identity)
                _carry_out(store, rig, work, control, options, parts_of(store)[0])


def extend(store_path: Path, campaign: CampaignFile, options: Options) -> None:
    """Run a further campaign into a finished store, on its rig: runs of both are analysed together.

    The rig's clock and the numbers of mountings go on; with `procedure.mounting = "same"` so does the mounting.
    `resume` finishes it when it is interrupted. `DataError` when the store's last campaign is not done.
    """
    with Store.open(store_path) as store, _store_to_oneself(store_path):
        state = store.status().get("state")
        if state != "done":
            raise DataError(
                f"{store_path} is {state or 'imported'}: only a campaign that is done can be gone on from"
            )
        if campaign.experiment != store.header.experiment:
            raise ConfigError(f"{campaign.path}: experiment: the store holds {store.header.experiment}")
        _require_same_item(store, campaign)
        # Where the last campaign has left the package.
        mounted = campaigns_of(campaign.experiment, campaign.path).mounted(store)
        plugins = _loaded_for(store, options.plugins, {})
        part = next_part(store, campaign.path, campaign.text, mounted, _brought(campaign, plugins))
        plan = _plan(campaign, part, plugins, options.workers)
        plan.require_goes_on(store)
        with _reopened(store, plan, campaign, part, options) as (rig, work, control, began_s):
            # Only with the rig in our hands: a further campaign that could not begin must not be kept as begun.
            begin_part(store, part, began_s)
            _carry_out(store, rig, work, control, options, part)


def _require_same_item(store: Store, campaign: CampaignFile) -> None:
    known, said = item_of(store).serial, campaign.item.serial
    if known and said and known != said:
        raise ConfigError(
            f"{campaign.path}: item.serial is {said}, and {store.path} is the calibration of {known}; "
            "name another store"
        )


def resume(store_path: Path, options: Options) -> None:
    """Go on with an interrupted campaign; what is recorded is not measured again. One that is done stays as it is."""
    with Store.open(store_path) as store, _store_to_oneself(store_path):
        if store.status().get("state") == "done":
            return
        part = parts_of(store)[-1]
        campaign = parse_campaign(part.toml, store_path)
        # Also the plug-ins the campaign was begun with: without them its model is another.
        plan = _plan(campaign, part, _loaded_for(store, options.plugins, part.plugins), options.workers)
        with _reopened(store, plan, campaign, part, options) as (rig, work, control, _):
            store.add_event(RESUMED, {"after": store.status().get("state", "")}, rig_time.latest_s(store))
            _carry_out(store, rig, work, control, options, part)


@contextmanager
def _reopened(
    store: Store, plan: Plan, campaign: CampaignFile, part: Part, options: Options
) -> Iterator[tuple[Rig, Work, Control, float]]:
    """The rig a store was made with, and the rig time before it was connected, which takes time.

    A plan it cannot carry out is refused before anything is connected.
    """
    file = informed(rig_file_of(store, with_world=True), store.header.extra).with_wire_log(options.wire_log)
    start_s = rig_time.start_s(store, part.number, virtual=file.rig.clock == "virtual")
    rig = Rig(file, seed=store.header.seed, start_s=start_s)
    work = _work(plan, rig, campaign)
    # Asked of the process that has ended; an old abort must not end this one.
    forget_requests(store)
    with in_charge(rig, campaign.on_terminal_lost, work.rest) as control:
        yield rig, work, control, start_s


def _loaded_for(store: Store, paths: Sequence[Path], needed: Plugins) -> list[Plugin]:
    """Files of effects; `ConfigError` unless those the store's model and a campaign `needed` are among them."""
    given = [model_versions.PluginFile.of(path) for path in paths]
    model_versions.current(store).require(given)
    files = [model_versions.PluginFile(**file) for file in needed.values()]
    model_versions.require_files(f"{store.path}: its campaign began", files, given)
    return [load(path) for path in paths]


def _brought(campaign: CampaignFile, plugins: Sequence[Plugin]) -> Plugins:
    """Where those effects of a campaign's model come from that are of files, as the store keeps it."""
    return {
        effect: {"path": str(plugin.path.resolve()), "sha256": plugin.sha256}
        for plugin in plugins
        for effect in plugin.effects
        if effect in campaign.model.effects
    }


def dry_run(
    campaign: CampaignFile, rig_file: RigFile, plugins: Sequence[Path] = (), workers: Workers | None = None
) -> dict[str, Any]:
    """What a campaign would do, checked against the rig's limits; nothing is connected, nothing moves."""
    plan = _plan(campaign, None, [load(path) for path in plugins], workers)
    rig = Rig(rig_file)
    _work(plan, rig, campaign)
    forecast = dict(plan.forecast(rig))
    layout = layout_of(campaign.experiment)
    doubts = layout.doubt_of_constants(rig_file.constants) if layout else ()
    warnings = [
        *rig_file.warnings,
        *(f"{rig_file.path}: constants.{name} {doubt}" for name, doubt in doubts),
        *(f"{campaign.path}: {each}" for each in forecast.pop("warnings", ())),
    ]
    return {
        "experiment": campaign.experiment,
        "procedure": campaign.procedure.get("name", ""),
        "runs_planned": plan.runs,
        "effects": list(campaign.model.effects),
        **forecast,
        **({"warnings": warnings} if warnings else {}),
    }


def _plan(campaign: CampaignFile, part: Part | None, plugins: Sequence[Plugin], workers: Workers | None) -> Plan:
    brought = [effect for plugin in plugins for effect in plugin.effects.values()]
    try:
        chosen(campaign.experiment, campaign.model.effects, brought)
    except ConfigError as error:
        raise ConfigError(f"{campaign.path}: model.effects: {error}") from None
    plan = plan_of(campaign, part, plugins)
    return plan if workers is None else plan.by(workers)


@contextmanager
def _store_to_oneself(path: Path) -> Iterator[None]:
    with locks.held(locks.store_lock(path), f"{path} is in use by another campaign; see `rigctl status`"):
        # The lock file may be of an earlier process, and its time long past.
        beat(path)
        yield


def _work(plan: Plan, rig: Rig, campaign: CampaignFile) -> Work:
    try:
        return plan.on(rig)
    except (ConfigError, LimitError) as error:
        raise type(error)(f"{campaign.path}: {error}") from None


def _carry_out(store: Store, rig: Rig, work: Work, control: Control, options: Options, part: Part) -> None:
    progress = Progress(store, options.display, part.runs_before)
    session = Session(store, rig.clock, _operator(store, rig, control, options), control, progress, part.number)
    # First of all on stable storage: a process that is killed from here on is seen as interrupted.
    progress.state("running")
    if logs := rig.wire_logs.files:
        session.event("wire-logs", files={name: str(path.absolute()) for name, path in logs.items()})
    if rig.found_moving:
        session.event("found-moving", instruments=list(rig.found_moving), done="stopped before anything else")
    try:
        # Only while the procedure runs: there is nothing to steer before and after.
        with RequestWatcher(store.path, control):
            work.run(session)
    except RigError as error:
        # After an abort every error is its echo: instruments were disconnected under the procedure.
        if control.aborted:
            progress.state("aborted")
            session.event("aborted", reason=control.reason)
            raise Aborted(control.reason) from error
        progress.state("aborted" if isinstance(error, Aborted) else "interrupted")
        session.event("failed", error=str(error))
        if refuses_input(error):
            # What was asked for was checked before: from here on it is the work that fails.
            raise ProcedureError(str(error)) from error
        raise
    # Also what is no error of ours: the store must say that the campaign did not end by itself.
    except BaseException:
        progress.state("interrupted")
        raise
    progress.state("done")
    session.event("done")


def _operator(store: Store, rig: Rig, control: Control, options: Options) -> Operator:
    heed = control.raise_if_aborted
    if options.unattended:
        return Operator(rig.operator_link, heed=heed)
    questions = Questions(store)
    return TerminalOperator(rig.operator_link, TypedLines(heed, questions.heard), questions, heed=heed)


def _write_truth(rig_file: RigFile, store_path: Path) -> None:
    world = only_tables(rig_file.text, "world")
    if world:
        truth = truth_path(store_path)
        with writing(truth):
            truth.write_text(world, encoding="utf-8")


def header_of(campaign: CampaignFile, rig: Rig, options: Options, kept: Mapping[str, Any]) -> Header:
    """The header of this campaign's store, which keeps `kept` too; nothing is connected."""
    file = rig.file
    channels, lasers = campaigns_of(campaign.experiment, campaign.path).channels(rig)
    return Header(
        experiment=campaign.experiment,
        title=campaign.title,
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        rig_toml=file.text_without_world,
        campaign_toml=campaign.text,
        world_sha256=file.world_sha256,
        seed=options.seed,
        versions=versions(),
        constants={name: constant.value for name, constant in file.constants.items()},
        channels=channels,
        lasers=lasers,
        extra={
            "certificates": {k: c.model_dump(mode="json") for k, c in file.certificates.items()},
            "unattended": options.unattended,
            **({ITEM: stated} if (stated := campaign.item.stated) else {}),
            **kept,
        },
    )


def versions() -> dict[str, str]:
    """Versions of what produced a record: packages, and the commit where the code is a checkout."""
    by_package = {name: importlib.metadata.version(name) for name in VERSIONED}
    try:
        head = subprocess.run(  # noqa: S603
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],  # noqa: S607
            capture_output=True,
            text=True,
            timeout=5,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return by_package
    return {**by_package, "commit": head.stdout.strip()} if head.returncode == 0 else by_package
