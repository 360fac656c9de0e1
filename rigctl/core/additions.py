"""What packages add to an experiment, this tree's own among them: modules of effects, and procedures of their own."""

from __future__ import annotations

from dataclasses import dataclass

from rigctl.core.entry_points import Registry

EFFECTS_CONTRACT = 1
"""The version of what is between this program and a module of effects: `rigctl.effects.effect`, points."""

PROCEDURE_CONTRACT = 1
"""The version of what is between this program and a procedure: its table, `procedures.campaigns.Plan`, sessions."""


@dataclass(frozen=True)
class Effects:
    """A module of effects of an experiment, an entry point of `rigctl.effects` by this name.

    `module` has functions decorated with `rigctl.effects.effect`. An experiment's own are named as it is and act
    before those of others.
    """

    name: str
    experiment: str
    module: str
    contract: int = EFFECTS_CONTRACT


@dataclass(frozen=True)
class Procedure:
    """A procedure beside those of an experiment's own `campaign`, an entry point of `rigctl.procedures` by its `id`.

    `name` is what `[procedure] name` is in a campaign file, `table` the pydantic model of that table, `plan` a
    function like `procedures.campaigns.Campaigns.plan`; both references are `package.module:object`.
    """

    experiment: str
    name: str
    table: str
    plan: str
    contract: int = PROCEDURE_CONTRACT

    @property
    def id(self) -> str:
        """The name of its entry point."""
        return f"{self.experiment}.{self.name}"


EFFECTS = Registry("rigctl.effects", Effects, EFFECTS_CONTRACT, lambda each: each.name)
PROCEDURES = Registry("rigctl.procedures", Procedure, PROCEDURE_CONTRACT, lambda each: each.id)


def effects_for(experiment: str) -> list[Effects]:
    """The modules of effects of an experiment, its own first, then others by name."""
    modules = (each for each in EFFECTS.sound() if each.experiment == experiment)
    # False sorts before True: the experiment's own come first.
    return sorted(modules, key=lambda each: (each.name != experiment, each.name))


def procedure_for(experiment: str, name: object) -> Procedure | None:
    """The procedure that a campaign file names, None for one of the experiment's own; `ConfigError`."""
    full_name = f"{experiment}.{name}"
    return PROCEDURES.get(full_name) if full_name in PROCEDURES.names() else None


def procedures_for(experiment: str) -> list[str]:
    """The names of the procedures beside the experiment's own."""
    return [each.name for each in PROCEDURES.sound() if each.experiment == experiment]
