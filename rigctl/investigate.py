"""Measure, diagnose, ask, add, measure again: until the model is adequate, or what remains can be said.

Nothing is kept but the store: what is measured next follows from what is in it, so that an investigation that was
interrupted goes on as if it had not been. Each time the question is put from the model the campaign began with:
what fewer runs suggested has no privilege.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from procedures.campaigns import SetPoints, investigable
from rigctl import runner
from rigctl.campaign.origin import campaign_of
from rigctl.campaign.recording import ImportReport, Recording
from rigctl.campaign.store.store import Store
from rigctl.composition import workbench_of
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.plugins import load
from rigctl.experiments.analysis import analysis_of
from rigctl.files.campaign_file import CampaignFile, parse_campaign
from rigctl.files.rig_file import RigFile
from rigctl.planning import text_of
from rigctl.rig import Rig
from rigctl.workbench.findings import Diagnosis
from rigctl.workbench.model import versions
from rigctl.workbench.next.exclusion import Excluded, Sensitivity, sensitivity
from rigctl.workbench.next.first_design import first_design
from rigctl.workbench.next.plan import shuffled
from rigctl.workbench.next.recommend import recommend
from rigctl.workbench.study import Plannable, Proposal, Study, Term
from rigctl.workbench.verdict.diagnose import diagnose
from rigctl.workbench.workbench import ALPHA

FIRST_RUNS, BATCH_RUNS = 12, 6
ROUND = "investigation"
"""The kind of document that keeps what a round found."""

Ask = Callable[[Store, str], bool]
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Settings:
    """How to investigate: `ask` decides whether an effect is added, `max_runs` None stands for a full scan's."""

    options: runner.Options
    ask: Ask
    tell: Tell
    max_runs: int | None = None
    alpha: float = ALPHA


@dataclass(frozen=True)
class Outcome:
    """How it ended: `remains` says what is open, "" when nothing is."""

    verdict: str
    added: tuple[str, ...]
    version: int
    effects: tuple[str, ...]
    runs: int
    full_scan: int
    rounds: int
    remains: str
    excluded: tuple[Excluded, ...] = field(default=())
    diagnosis: Diagnosis | None = None

    def as_json(self) -> dict[str, Any]:
        """Keys of `rigctl investigate --json`."""
        return {
            "verdict": self.verdict,
            "added": list(self.added),
            "model": {"version": self.version, "effects": list(self.effects)},
            "runs": self.runs,
            "full_scan_runs": self.full_scan,
            "rounds": self.rounds,
            "remains": self.remains,
            "sensitivity": [each.as_json() for each in self.excluded],
            "diagnosis": None if self.diagnosis is None else self.diagnosis.as_json(),
        }


def investigate(campaign: CampaignFile, rig_file: RigFile | None, store_path: Path, settings: Settings) -> Outcome:
    """Find what acts on a rig that its model lacks, with as few runs as that takes; goes on where it was.

    `rig_file` is needed to begin, later on the store has it. `ConfigError` for a campaign
    among whose runs nothing can be chosen; errors of instruments as they come.
    """
    points = investigable(campaign).set_points(campaign)
    most = settings.max_runs or len(points.full_scan)
    if not store_path.exists():
        if rig_file is None:
            raise ConfigError(f"{campaign.path}: rig is missing; name the rig file")
        _begin(campaign, rig_file, store_path, points, min(FIRST_RUNS, most), settings)
    _require_same(campaign, store_path)
    rounds = 0
    while True:
        _finish(store_path, settings)
        rounds += 1
        with Store.open(store_path) as store:
            round_ = _Round(store, points, most, settings)
            batch = round_.next_batch()
            if not batch:
                return round_.outcome(rounds)
            text = _text(campaign, batch, f"Round {rounds + 1}")
        runner.extend(store_path, parse_campaign(text, campaign.path), settings.options)


class _Round:
    """What a store says so far: the diagnosis, the model brought up to date with it, what to measure next."""

    def __init__(self, store: Store, points: SetPoints, most: int, settings: Settings) -> None:
        self._store = store
        self._points, self._most, self._settings = points, most, settings
        self._bench = workbench_of(store, settings.options.plugins)
        self._study = study = _plannable(self._bench.study, store.path)
        # Another order in every round, and the same one when the round is resumed.
        self._seed = points.seed + len(store.runs())
        self._given = self._bench.version(1).terms
        self._declined: list[str] = []
        # From the model the campaign began with: what fewer runs suggested has no privilege.
        self._diagnosis = diagnose(study, self._given, settings.alpha, progress=None)
        self._settings.tell(f"{self._made} runs: {self._diagnosis.verdict} {' '.join(self._effects)}".rstrip())
        self._bring_model_up_to_date()
        self._sensitivity = self._judge()

    @property
    def _made(self) -> int:
        return len(self._store.runs())

    @property
    def _effects(self) -> list[str]:
        return [term.effect for term in self._diagnosis.suggested]

    @property
    def _terms(self) -> tuple[Term, ...]:
        """The model the diagnosis ended with."""
        return self._diagnosis.steps[-1].terms

    def _bring_model_up_to_date(self) -> None:
        """Add what was found, take out what no longer is; ambiguous ones wait until they are told apart."""
        now = self._bench.current
        wanted = [] if self._diagnosis.verdict == "ambiguous" else [t for t in self._terms if t not in self._given]
        # Suggested by fewer runs, and no longer: it leaves the model again.
        stale = [t.effect for t in now.terms if t not in self._given and t not in wanted]
        if stale and self._diagnosis.verdict != "ambiguous":
            versions.remove_all(self._store, stale)
            self._settings.tell(f"no longer needed: {', '.join(stale)}")
        for term in wanted:
            if term in versions.current(self._store).terms:
                continue
            if self._settings.ask(self._store, f"Add {term.effect} to the model?"):
                versions.extend(self._store, term, self._bench.source_of(term.effect))
                self._settings.tell(f"added {term.effect}")
            else:
                self._declined.append(term.effect)

    def _judge(self) -> Sensitivity:
        # Never negative: `max_runs` may have been lowered since.
        room = max(min(BATCH_RUNS, self._most - self._made), 0)
        return sensitivity(
            self._study,
            self._terms,
            _spread_in_time(self._points.full_scan),
            self._points.options,
            self._settings.alpha,
            room,
            self._points.run_price_s(self._most),
        )

    def next_batch(self) -> tuple[Proposal, ...]:
        """The runs to go on with; empty when it is decided, or nothing more may be measured."""
        room = min(BATCH_RUNS, self._most - self._made)
        if room <= 0 or self._declined:
            return ()
        # Rivals that explain the data equally well are told apart before anything is excluded.
        batch = self._separating(room) or self._sensitivity.batch
        self._store.add_document(
            ROUND,
            {
                "runs": self._made,
                "verdict": self._diagnosis.verdict,
                "suggested": self._effects,
                "next": [dict(run.settings) for run in batch],
            },
        )
        if batch:
            open_ = sorted({each.effect for each in self._sensitivity.parameters if each.share < 1.0})
            self._settings.tell(f"measuring {len(batch)} more, to see or exclude {', '.join(open_) or 'rivals'}")
        # In random order, so that what drifts with time does not look like what was set.
        return shuffled(batch, self._seed)

    def _separating(self, room: int) -> tuple[Proposal, ...]:
        """Runs that tell rivals apart; none where there are no rivals, or nothing tells them."""
        if self._diagnosis.verdict != "ambiguous":
            return ()
        recommendation = recommend(
            self._study,
            self._given,
            self._diagnosis,
            offered=self._points.options,
            seed=self._seed,
            most_runs=room,
        )
        return recommendation.runs if recommendation.purpose == "separate" else ()

    def outcome(self, rounds: int) -> Outcome:
        """How it ended, the model asked once more as it now stands."""
        version = self._bench.current
        last = self._diagnosis
        if version.terms != self._given:
            last = diagnose(self._study, version.terms, self._settings.alpha)
        versions.keep_diagnosis(self._store, self._bench.plugin_files, version, self._settings.alpha, last.as_json())
        return Outcome(
            verdict=last.verdict,
            added=tuple(term.effect for term in version.terms if term not in self._given),
            version=version.version,
            effects=version.effects,
            runs=self._made,
            full_scan=len(self._points.full_scan),
            rounds=rounds,
            remains=self._remains(last),
            excluded=self._sensitivity.parameters,
            diagnosis=last,
        )

    def _remains(self, last: Diagnosis) -> str:
        remaining = []
        if self._declined:
            remaining.append(f"not added, as you chose: {', '.join(self._declined)}")
        if last.unexplained is not None:
            remaining.append(f"none of the known effects explains: {last.unexplained.description}")
        elif last.verdict == "ambiguous":
            alike = [(rank.term.effect, *rank.equivalent_to) for rank in last.ranking if rank.term in last.suggested]
            remaining += [f"equally good: {' or '.join(each)}" for each in alike if len(each) > 1]
        unseen = sorted({each.effect for each in self._sensitivity.parameters if each.share < 1.0})
        if unseen:
            remaining.append(f"not excluded as far as a full scan would: {', '.join(unseen)}")
        return "; ".join(remaining)


def _plannable(study: Study, path: Path) -> Plannable:
    if not isinstance(study, Plannable):
        raise DataError(f"{path}: a '{study.experiment}' recording cannot be gone on with")
    return study


def _begin(
    campaign: CampaignFile,
    rig_file: RigFile,
    store_path: Path,
    points: SetPoints,
    count: int,
    settings: Settings,
) -> None:
    """The first runs, into a new store."""
    # Refused before the first design is computed, and before anything is connected.
    runner.dry_run(campaign, rig_file, settings.options.plugins)
    header = runner.header_of(campaign, Rig(rig_file), settings.options, {})
    # Plug-ins may add effects that the first design has to be able to see.
    plugins = [load(path) for path in settings.options.plugins]
    # A recording without runs: the study then knows instruments and effects, and no data.
    study = analysis_of(campaign.experiment).study(Recording(header, (), {}, ImportReport(0)), plugins)
    placed = [Proposal({**each.settings, **points.place}, each.takes_s) for each in points.options]
    terms = [Term(effect) for effect in campaign.model.effects]
    price_s = points.run_price_s(settings.max_runs or len(points.full_scan))
    runs = first_design(_plannable(study, campaign.path), terms, placed, count, points.seed, price_s)
    settings.tell(f"beginning with {len(runs)} runs of {len(points.full_scan)} that a full scan has")
    text = _text(campaign, runs, "Round 1")
    runner.start(parse_campaign(text, campaign.path), rig_file, store_path, settings.options)


def _finish(store_path: Path, settings: Settings) -> None:
    """What was interrupted is measured to its end."""
    with Store.open(store_path, readonly=True) as store:
        state = store.status().get("state")
    if state != "done":
        settings.tell(f"going on with what was {state or 'interrupted'}")
        # A kill may have come in the middle of a round; its plan is in the store.
        runner.resume(store_path, settings.options)


def _require_same(campaign: CampaignFile, store_path: Path) -> None:
    """A store of another place or model is another investigation."""
    with Store.open(store_path, readonly=True) as store:
        begun = campaign_of(store)
    ours, recorded = ((investigable(each).set_points(each).place, each.model.effects) for each in (campaign, begun))
    if ours != recorded:
        raise ConfigError(f"{store_path} was begun with another campaign file; choose another --store")


def _text(campaign: CampaignFile, runs: Sequence[Proposal], title: str) -> str:
    named = f"{campaign.title}: {title}" if campaign.title else title
    procedure = investigable(campaign).chosen_runs(campaign, runs)
    return text_of(campaign, named, campaign.rig, procedure, campaign.model.effects)


def _spread_in_time(full_scan: Sequence[Proposal]) -> list[Proposal]:
    """A full scan as it would be measured: one run after the other, in random order."""
    # Always the same order, so that an investigation that was interrupted judges alike.
    order = np.random.default_rng(0).permutation(len(full_scan))
    starts = np.cumsum([0.0, *(each.takes_s for each in full_scan)])
    return [
        Proposal({**each.settings, "start_s": float(starts[place])}, each.takes_s)
        for each, place in zip(full_scan, order, strict=True)
    ]
