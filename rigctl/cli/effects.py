"""The catalogue of physical effects."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rigctl.cli.io import Json, Plugins, print_json, say, tell
from rigctl.core.additions import EFFECTS
from rigctl.core.errors import ConfigError, DataError
from rigctl.core.experiments import EXPERIMENTS, REGISTRY
from rigctl.core.whole_file import writing
from rigctl.effects.catalogue import Effect, catalogue, experiment_of, unknown_effect
from rigctl.effects.plugins import load
from rigctl.effects.trial import columns_of

app = typer.Typer(add_completion=False)


@app.command()
def effects(
    effect: Annotated[
        str | None, typer.Argument(metavar="ID", help="Tell all about this one: ID, or EXPERIMENT:ID.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(metavar="FILE.svg", help="Draw its signature.")] = None,
    plugin: Plugins = None,
    as_json: Json = False,
) -> None:
    """The catalogue of physical effects, or one of them: equation, parameters, source."""
    # Told and not raised: one bad package must not hide the effects of all others.
    for registry in (REGISTRY, EFFECTS):
        for flaw in registry.flaws():
            tell(flaw)
    known = _known(plugin or ())
    if effect is None:
        if figure is not None:
            raise ConfigError("--figure draws one effect: name it, as in `rigctl effects roll-gravity --figure FILE`")
        if as_json:
            print_json([_as_json(each) for each in known])
        else:
            _print_catalogue(known)
        return
    experiment, _, name = effect.rpartition(":")
    matching = [each for each in known if each.id == name and experiment in ("", experiment_of(each).id)]
    if not matching:
        raise unknown_effect(effect, [each.id for each in known])
    if figure is not None:
        _draw(matching[0], figure)
    if as_json:
        # One document, as for an effect of one experiment alone; the others of this id go with it.
        print_json({**_as_json(matching[0]), "others": [_as_json(each) for each in matching[1:]]})
    else:
        for each in matching:
            _print_effect(each)


def _known(plugins: Sequence[Path]) -> list[Effect]:
    """Every experiment's effects: an id may mean one thing here and another there."""
    added = [effect for path in plugins for effect in load(path).effects.values()]
    return [each for experiment in EXPERIMENTS for each in catalogue(experiment, added).values()]


def _as_json(effect: Effect) -> dict[str, Any]:
    return {
        "id": effect.id,
        "experiment": experiment_of(effect).id,
        "on": effect.on,
        "summary": effect.summary,
        "parameters": effect.parameters,
        "typical": effect.typical,
        "scope": effect.scope,
        "needs": effect.needs,
        "columns": columns_of(effect),
        "source": effect.source,
    }


def _print_catalogue(listed: Sequence[Effect]) -> None:
    width = max(len(each.id) for each in listed)
    experiment = ""
    for each in listed:
        if experiment_of(each).id != experiment:
            experiment = experiment_of(each).id
            say(f"{experiment}:")
        say(f"{each.id:{width}}  {each.summary}")
    say("A `table` recording has a catalogue made from its columns: linear[C], power2[C], power3[C], inverse[C],")
    say("exponential[C], periodic[C], step[C], interaction[A,B], drift, offset; of its words level[C].")


def _print_effect(effect: Effect) -> None:
    each = effect.scope.replace("-", " and ")
    say(f"{effect.id} ({experiment_of(effect).id}), acts on {effect.on}, one value per {each}")
    say(inspect.cleandoc(effect.function.__doc__ or ""))
    for name, unit in effect.parameters.items():
        say(f"  {name} / {unit or '1'}, typically {effect.typical[name]:g}")
    if needed := [*effect.needs, *(f"column {name}" for name in columns_of(effect))]:
        say(f"  needs to be recorded: {', '.join(needed)}")
    if effect.source:
        say(f"source: {effect.source}")


def _draw(effect: Effect, path: Path) -> None:
    if columns := columns_of(effect):
        raise DataError(
            f"'{effect.id}' needs {', '.join(columns)} of a recording: without, it has no signature to draw; "
            "`rigctl report` draws a store's residuals against such columns"
        )
    experiment = experiment_of(effect)
    if not experiment.signature:
        raise DataError(
            f"'{effect.id}' has no figure: no signature is drawn for effects of {experiment.id}; "
            "`rigctl report` draws what is left in a store's runs with and without it"
        )
    svg = experiment.load(experiment.signature)(effect).svg
    with writing(path):
        path.write_text(svg, encoding="utf-8")
