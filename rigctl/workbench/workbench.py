"""A store on the workbench: compare, diagnose, add, fit, and the ladder of what each version brought."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.campaign.store.store import Store
from rigctl.core.errors import ConfigError, DataError
from rigctl.effects.catalogue import unknown_effect
from rigctl.workbench.findings import Comparison, Diagnosis, ModelFit
from rigctl.workbench.model import versions
from rigctl.workbench.model.versions import ModelVersion, PluginFile
from rigctl.workbench.study import Study, Term

if TYPE_CHECKING:
    from rigctl.effects.plugins import Plugin
    from rigctl.workbench.next.recommendation import Recommendation
    from rigctl.workbench.study import Allowed
    from rigctl.workbench.verdict.attempt import Attempt
    from rigctl.workbench.verdict.transfer import Transfer

ALPHA = 0.01


class Workbench:
    """A store, its study, and the versions of its model; `plugins` are files with effects of one's own.

    `study_with` makes the study of the store's runs, with what plug-ins add to its effects; `allowed` says which
    proposals the store's rig can carry out. `ConfigError` when a plugin cannot be loaded.
    """

    def __init__(
        self,
        store: Store,
        study_with: Callable[[Sequence[Plugin]], Study],
        plugins: Sequence[Path] = (),
        allowed: Callable[[], Allowed | None] = lambda: None,
    ) -> None:
        self.store = store
        self._study_with, self._allowed = study_with, allowed
        self._attempts: dict[int, Attempt] = {}
        self._plugins = {PluginFile.of(path): _loaded(path) for path in plugins}

    @cached_property
    def study(self) -> Study:
        """The store's valid runs, reduced once."""
        return self._study_with(list(self._plugins.values()))

    def study_with_files(self, files: Sequence[Path]) -> Study:
        """The same runs, with the effects of further files in the catalogue."""
        return self._study_with([*self._plugins.values(), *map(_loaded, files)])

    @property
    def current(self) -> ModelVersion:
        """The store's model; `ConfigError` without the plugin files it was made with."""
        return self._usable(versions.current(self.store))

    def version(self, number: int) -> ModelVersion:
        """One version; `ConfigError` without its plugin files."""
        return self._usable(versions.versions(self.store)[number - 1])

    def _usable(self, version: ModelVersion) -> ModelVersion:
        version.require(list(self._plugins))
        return version

    def compare(self, version: ModelVersion | None = None) -> Comparison:
        """A version's model, by default the current one, beside the data."""
        from rigctl.workbench.verdict.compare import compared

        chosen = version or self.current
        return compared(self._attempt(chosen), chosen.version)

    def compare_with(self, other: Workbench) -> Transfer:
        """The current model on another store: does what was fitted here hold there?"""
        from rigctl.workbench.verdict.transfer import transfer

        return transfer(self.study, other.study, self.current.terms)

    def fit(self, version: ModelVersion | None = None) -> ModelFit:
        """Fit a version, by default the current one, and keep the outcome."""
        from rigctl.workbench.verdict.fit import fitted

        chosen = version or self.current
        found = fitted(self._attempt(chosen))
        versions.keep_fit(self.store, chosen, found.as_json())
        return found

    def _attempt(self, version: ModelVersion) -> Attempt:
        """A version fitted, once: the runs of a workbench are those it found."""
        from rigctl.workbench.verdict.attempt import Attempt

        if version.version not in self._attempts:
            self._attempts[version.version] = Attempt(self.study, version.terms)
        return self._attempts[version.version]

    def diagnose(self, alpha: float = ALPHA, progress: Callable[[str], None] | None = None) -> Diagnosis:
        """Ask what the current model lacks, and keep the answer; adds nothing."""
        from rigctl.workbench.verdict.diagnose import diagnose

        if not 0.0 < alpha < 1.0:
            raise ConfigError(f"alpha {alpha:g} is no level; give one between 0 and 1, such as {ALPHA:g}")
        version = self.current
        found = self._with_next(diagnose(self.study, version.terms, alpha=alpha, progress=progress))
        versions.keep_diagnosis(self.store, version, alpha, found.as_json())
        return found

    def _with_next(self, found: Diagnosis) -> Diagnosis:
        """What to measure where something is ambiguous; `recommend` tells it of everything else, in longer time."""
        from rigctl.workbench.next.recommend import recommend

        if found.verdict != "ambiguous":
            return found
        further = recommend(self.study, found.terms, found, allowed=self._allowed())
        return replace(found, next_measurement=further.as_json())

    def recommend(self, progress: Callable[[str], None] | None = None, alpha: float = ALPHA) -> Recommendation:
        """What to measure next, after a diagnosis of the current model, with the rig that measured."""
        from rigctl.workbench.next.recommend import recommend
        from rigctl.workbench.verdict.diagnose import diagnose

        terms = self.current.terms
        found = diagnose(self.study, terms, alpha, progress=progress)
        return recommend(self.study, terms, found, allowed=self._allowed())

    def history(self, progress: Callable[[str], None] | None = None) -> list[dict[str, Any]]:
        """The error ladder, keys of `rigctl model history --json`; fits what has not been fitted to these runs.

        An older version whose plugin file is not there has no numbers, and a `note` says why.
        """
        versions.current(self.store).require(list(self._plugins))
        return [self._rung(version, progress) for version in versions.versions(self.store)]

    def _rung(self, version: ModelVersion, progress: Callable[[str], None] | None) -> dict[str, Any]:
        rung = {
            "version": version.version,
            "effects": list(version.effects),
            "added": version.added,
            "removed": version.removed,
        }
        found = versions.kept_fit(self.store, version)
        if found is None:
            try:
                version.require(list(self._plugins))
            except ConfigError as error:
                return {**rung, "chi2_per_dof": None, "error_fit": None, "error_held_out": None, "note": str(error)}
            if progress is not None:
                progress(f"fitting version {version.version}")
            found = self.fit(version).as_json()
        return {**rung, **{key: found[key] for key in ("chi2_per_dof", "error_fit", "error_held_out", "result")}}

    def add(self, effects: Sequence[str]) -> list[ModelVersion]:
        """One new version per effect, all of them or none; `ConfigError` for one that is unknown or there already."""
        self._require_known(effects)
        now, added = self.current, list[Term]()
        for effect in effects:
            added.append(self._term(effect, (*now.terms, *added)))
        return [versions.extend(self.store, term, self.source_of(term.effect)) for term in added]

    def remove(self, effects: Sequence[str]) -> list[ModelVersion]:
        """One new version per effect, without it; `ConfigError` for one that is not in the model."""
        return versions.remove_all(self.store, effects)

    def _require_known(self, effects: Sequence[str]) -> None:
        known = self.study.effects()
        for effect in effects:
            if effect.split("#")[0] not in known:
                raise unknown_effect(effect, known)

    def _term(self, effect: str, terms: Sequence[Term]) -> Term:
        """With the choice of the last diagnosis, else the one that fits best beside `terms`.

        What is chosen may be there more than once: one head's error, then another's.
        """
        from rigctl.workbench.verdict.choices import best, diagnosed

        there = [term for term in terms if term.effect == effect]
        found = diagnosed(versions.last_diagnosis(self.store), effect)
        if not all(term.choice for term in there):
            raise versions.there_already(effect)
        if found is not None and found not in there:
            return found
        try:
            return best(self.study, terms, effect)
        except DataError:
            if there:
                raise versions.there_already(effect) from None
            raise

    def source_of(self, effect: str) -> PluginFile | None:
        """The file that brought an effect; None for those of the catalogue."""
        return next((file for file, plugin in self._plugins.items() if effect in plugin.effects), None)


def _loaded(path: Path) -> Plugin:
    from rigctl.effects import plugins

    return plugins.load(path)
