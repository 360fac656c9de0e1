"""A store on the workbench: compare, diagnose, add, fit, and the ladder of what each version brought."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rigctl.campaign.store.store import Store
from rigctl.core.errors import UNFIT, ConfigError, DataError, ProcedureError
from rigctl.core.threads import one_thread
from rigctl.effects.catalogue import unknown_effect
from rigctl.workbench.findings import Comparison, Diagnosis, ModelFit
from rigctl.workbench.model import versions
from rigctl.workbench.model.versions import ModelVersion, PluginFile
from rigctl.workbench.study import Study, Term

if TYPE_CHECKING:
    from rigctl.effects.plugins import Plugin
    from rigctl.workbench.next.recommendation import Recommendation
    from rigctl.workbench.study import Allowed
    from rigctl.workbench.verdict.account import Account
    from rigctl.workbench.verdict.attempt import Attempt
    from rigctl.workbench.verdict.fitted_model import FittedModel
    from rigctl.workbench.verdict.likelihood import Optimum
    from rigctl.workbench.verdict.transfer import Transfer

ALPHA = 0.01

SAME = 1e-9
"""Of chi-square: fits that differ by less differ by their rounding."""

RUNG = (
    "chi2_per_dof",
    "error_fit",
    "error_held_out",
    "rms",
    "minus_2_log_l",
    "held_out_log_score",
    "result",
    "noise",
    "warnings",
)
"""Keys of a fit that the ladder shows."""


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
        self._optima: dict[int, Optimum] = {}
        self._fits: dict[int, ModelFit] = {}
        self._account: tuple[list[tuple[Term, ...]], Account] | None = None
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
        version.require(self.plugin_files)
        return version

    @one_thread
    def compare(self, version: ModelVersion | None = None) -> Comparison:
        """A version's model, by default the current one, beside the data."""
        # Imported where it is used, here and below: loading scipy would delay every other command.
        from rigctl.workbench.verdict.compare import compared

        chosen = version or self.current
        kept = versions.kept_comparison(self.store, self.plugin_files, chosen)
        found = compared(self.attempt(chosen), self.account(), chosen.version, kept)
        if kept is None:
            versions.keep_comparison(self.store, self.plugin_files, chosen, found.as_json())
        self._keep_account()
        return found

    def comparison(self) -> dict[str, Any]:
        """`compare` of the current model as JSON; what the store keeps of the same question is not asked again."""
        kept = versions.kept_comparison(self.store, self.plugin_files, self.current)
        return kept or self.compare().as_json()

    def model_fit(self) -> dict[str, Any]:
        """`fit` of the current model, likewise."""
        return versions.kept_fit(self.store, self.plugin_files, self.current) or self.fit().as_json()

    def diagnosis(self, alpha: float = ALPHA, progress: Callable[[str], None] | None = None) -> dict[str, Any]:
        """`diagnose`, likewise; it is the last one that was asked for."""
        version = self.current
        kept = versions.kept_diagnosis(self.store, self.plugin_files, version, alpha)
        if kept is None:
            return self.diagnose(alpha, progress).as_json()
        # What is added next starts from what was said last.
        if kept != versions.last_diagnosis(self.store):
            versions.keep_diagnosis(self.store, self.plugin_files, version, alpha, kept)
        return kept

    @one_thread
    def compare_with(self, other: Workbench) -> Transfer:
        """The current model on another store: does what was fitted here hold there?"""
        from rigctl.workbench.verdict.transfer import transfer

        return transfer(self.study, other.study, self.current.terms)

    @one_thread
    def fitted(self, version: ModelVersion | None = None) -> ModelFit:
        """A version, by default the current one, fitted to the runs."""
        from rigctl.workbench.verdict.fit import fitted

        chosen, account = version or self.current, self.account()
        if chosen.version not in self._fits:
            # A comparison asks the same, and it takes long.
            kept = versions.kept_comparison(self.store, self.plugin_files, chosen) or {}
            attempt, optimum, warnings = self.attempt(chosen), self._optimum(chosen), self._warnings(chosen)
            found = fitted(attempt, account, optimum, warnings, kept.get("p_value"))
            self._fits[chosen.version] = found
        return self._fits[chosen.version]

    def fit(self, version: ModelVersion | None = None) -> ModelFit:
        """The same, and keep the outcome."""
        chosen = version or self.current
        found = self.fitted(chosen)
        versions.keep_fit(self.store, self.plugin_files, chosen, found.as_json())
        self._keep_account()
        return found

    def attempt(self, version: ModelVersion) -> Attempt:
        """A version fitted, once: the runs of a workbench are those it found. It fits no worse than its parent."""
        account = self.account()
        if version.version not in self._attempts:
            held = versions.still_held(self.store, version)
            made = account.attempt(self.study, version.terms, version.start, held)
            parent = self._parent(version)
            nested = parent is not None and all(term in version.terms for term in parent.terms)
            if parent is not None and nested and made.result.chi2 > parent.result.chi2 * (1.0 + SAME):
                # From where it was promised, beside other terms, the way led to a minimum of another kind.
                made = account.attempt(self.study, version.terms, parent.values, held)
            self._attempts[version.version] = made
        return self._attempts[version.version]

    def _parent(self, version: ModelVersion) -> Attempt | None:
        """The fit of the version it was made from; None where there is none, or it cannot be fitted."""
        if version.parent is None:
            return None
        parent = versions.versions(self.store)[version.parent - 1]
        return self._attempt_if_fit(parent) if parent.can_be_used_with(self.plugin_files) else None

    def _optimum(self, version: ModelVersion) -> Optimum:
        """Where a version is likeliest; no less likely than any version with some of its terms."""
        from rigctl.workbench.verdict.likelihood import maximum_likelihood

        attempt = self.attempt(version)
        if version.version not in self._optima:
            fewer = [each for each in self._usable_versions() if set(each.effects) < set(version.effects)]
            # With the same choices: the same effect with another period is no part of this model.
            fewer = [each for each in fewer if all(term in version.terms for term in each.terms)]
            # A term may be determined only beside the one that was added after it.
            fewer = [each for each in fewer if self._attempt_if_fit(each) is not None]
            # What is in another of them is no likelier than that one.
            sets = [set(each.effects) for each in fewer]
            largest = [each for each, own in zip(fewer, sets, strict=True) if not any(own < other for other in sets)]
            parents = [self._optimum(each) for each in largest]
            self._optima[version.version] = maximum_likelihood(attempt, attempt.estimator, parents)
        return self._optima[version.version]

    def _attempt_if_fit(self, version: ModelVersion) -> Attempt | None:
        """A version fitted; None where the data do not determine it."""
        try:
            return self.attempt(version)
        except UNFIT:
            return None

    def _warnings(self, version: ModelVersion) -> list[str]:
        """What speaks against a version's fit: a promise that is not kept, runs held out that it predicts worse."""
        from rigctl.workbench.verdict.promise import warnings

        parent = None if version.added is None else self._parent(version)
        return warnings(self.attempt(version), parent, version.start)

    def _usable_versions(self) -> list[ModelVersion]:
        return [each for each in versions.versions(self.store) if each.can_be_used_with(self.plugin_files)]

    def account(self, progress: Callable[[str], None] | None = None) -> Account:
        """The noise of the store's data, estimated once for all versions that can be used."""
        terms = [each.terms for each in self._usable_versions()]
        known, account = self._account or ([], None)
        if account is None or known != terms:
            if account is None or known != terms[: len(known)] or not all(map(account.covers, terms[len(known) :])):
                # A version more changes the noise, and with it every fit there was.
                account = self._account_of(terms, progress)
                self._attempts, self._optima, self._fits = {}, {}, {}
            self._account = (terms, account)
        return account

    def _account_of(self, terms: list[tuple[Term, ...]], progress: Callable[[str], None] | None) -> Account:
        """From what the store keeps of these versions, or of the first of them, as far as that goes."""
        from rigctl.workbench.verdict.account import account_of, recalled

        earlier = None
        for count in range(len(terms), 0, -1):
            if kept := versions.kept_account(self.store, self.plugin_files, terms[:count]):
                earlier = (count, recalled(self.study, kept))
                break
        return account_of(self.study, terms, progress=progress, earlier=earlier)

    def _keep_account(self) -> None:
        terms = [each.terms for each in self._usable_versions()]
        if versions.kept_account(self.store, self.plugin_files, terms) is None:
            versions.keep_account(self.store, self.plugin_files, terms, self.account().as_document())

    @property
    def plugin_files(self) -> list[PluginFile]:
        """The files that were given, with what they held."""
        return list(self._plugins)

    @one_thread
    def diagnose(self, alpha: float = ALPHA, progress: Callable[[str], None] | None = None) -> Diagnosis:
        """Ask what the current model lacks, and keep the answer; adds nothing."""
        from rigctl.workbench.verdict.diagnose import diagnose

        if not 0.0 < alpha < 1.0:
            raise ConfigError(f"alpha {alpha:g} is no level; give one between 0 and 1, such as {ALPHA:g}")
        version = self.current
        account = self.account(progress)
        found = diagnose(self.study, version.terms, alpha, 0, progress, account, self.attempt(version))
        found = self._with_next(found)
        versions.keep_diagnosis(self.store, self.plugin_files, version, alpha, found.as_json())
        self._keep_account()
        return found

    def _with_next(self, found: Diagnosis) -> Diagnosis:
        """What to measure where something is ambiguous; `recommend` tells it of everything else, in longer time."""
        from rigctl.workbench.next.recommend import recommend
        from rigctl.workbench.next.recommendation import Recommendation

        if found.verdict != "ambiguous":
            return found
        try:
            further = recommend(self.study, found.terms, found, allowed=self._allowed())
        except UNFIT as error:  # the verdict stands, whatever could be measured next
            further = Recommendation("none", (), f"Nothing is known of what to measure next: {error}.")
        return replace(found, next_measurement=further.as_json())

    @one_thread
    def recommend(self, progress: Callable[[str], None] | None = None, alpha: float = ALPHA) -> Recommendation:
        """What to measure next, after a diagnosis of the current model, with the rig that measured."""
        from rigctl.workbench.next.recommend import recommend
        from rigctl.workbench.verdict.diagnose import diagnose

        version, account = self.current, self.account(progress)
        found = diagnose(self.study, version.terms, alpha, 0, progress, account, self.attempt(version))
        return recommend(self.study, version.terms, found, allowed=self._allowed())

    @one_thread
    def history(self, progress: Callable[[str], None] | None = None) -> list[dict[str, Any]]:
        """The error ladder, keys of `rigctl model history --json`; fits what has not been fitted to these runs.

        An older version whose plugin file is not there, or which the data do not determine, has no numbers, and a
        `note` says why.
        """
        versions.current(self.store).require(self.plugin_files)
        return [self._rung(version, progress) for version in versions.versions(self.store)]

    def _rung(self, version: ModelVersion, progress: Callable[[str], None] | None) -> dict[str, Any]:
        rung = {
            "version": version.version,
            "effects": list(version.effects),
            "added": version.added,
            "removed": version.removed,
        }
        usable = version.can_be_used_with(self.plugin_files)
        # Of a version whose files are not there counts what was fitted when they were.
        found = versions.kept_fit(self.store, self.plugin_files if usable else [*version.plugins.values()], version)
        if found is None:
            try:
                version.require(self.plugin_files)
                if progress is not None:
                    progress(f"fitting version {version.version}")
                found = self.fit(version).as_json()
            except UNFIT as error:
                return {**rung, **dict.fromkeys(RUNG), "note": str(error)}
        return {**rung, **{key: found[key] for key in RUNG}}

    @one_thread
    def add(self, effects: Sequence[str]) -> list[ModelVersion]:
        """One new version per effect, all of them or none; `ConfigError` for one that is unknown or there already,
        `DataError` where the data do not determine the model with all of them."""
        from rigctl.workbench.verdict.fitted_model import scanned_places
        from rigctl.workbench.verdict.promise import joint_fit

        self._require_known(effects)
        now, added = self.current, list[Term]()
        for effect in effects:
            added.append(self._term(effect, (*now.terms, *added)))
        joint = joint_fit(versions.last_diagnosis(self.store), added)
        fitted = self._require_determined((*now.terms, *added), added, joint)
        places = scanned_places(fitted.model, fitted.values if joint is None else joint[0])
        last = len(added) - 1
        return [
            # The fit of all together belongs to the version that has them all.
            versions.extend(self.store, term, self.source_of(term.effect), joint if number == last else None, places)
            for number, term in enumerate(added)
        ]

    def _require_determined(
        self,
        terms: Sequence[Term],
        added: Sequence[Term],
        joint: tuple[Mapping[str, float], Sequence[str]] | None,
    ) -> FittedModel:
        """A fit with these terms; `DataError` unless it tells all that are `added`: every command would fail."""
        from rigctl.workbench.verdict.fitted_model import fit_with_given_noise

        start, held = joint or ({}, ())
        try:
            return fit_with_given_noise(self.study.model(terms), start, held=frozenset(held))
        except ProcedureError as error:
            names = ", ".join(f"'{term.effect}'" for term in added)
            raise DataError(f"{names} cannot be added to a model of these data: {error}") from None

    def remove(self, effects: Sequence[str]) -> list[ModelVersion]:
        """One new version per effect, without it; `ConfigError` for one that is not in the model."""
        return versions.remove_all(self.store, effects)

    def _require_known(self, effects: Sequence[str]) -> None:
        known = self.study.effects()
        for effect in effects:
            # `#2` marks a second term of one effect.
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
