"""The commands there are. Each is imported when it is used: the help of all needs nothing that they work with."""

from __future__ import annotations

import ast
import importlib
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

MODULES = {
    "campaigns": ("run", "resume"),
    "steering": ("pause", "abort", "answer", "status", "mark"),
    "results": ("result",),
    "report": ("report",),
    "workbench": ("compare", "diagnose", "fit"),
    "model": ("model",),
    "planning": ("next", "investigate"),
    "effects": ("effects",),
    "exchange": ("import", "export"),
    "simulate": ("simulate",),
    "instruments": ("check", "stop", "home", "move"),
    "console": ("console",),
}
"""Commands by the module of this package whose Typer application `app` has them, in the order of the help."""


class LazyCommand(TyperCommand):
    """A command, or a group of them, whose module is not imported yet."""

    def __init__(self, name: str, module: str) -> None:
        super().__init__(name)
        self._module = f"{__package__}.{module}"

    def make_context(self, *args: Any, **kwargs: Any) -> Any:
        """Click's first call of a command that is used: from here on the one in the module acts."""
        return self.imported().make_context(*args, **kwargs)

    def imported(self) -> Any:
        """The command in its module."""
        command = get_command(importlib.import_module(self._module).app)
        if isinstance(command, TyperGroup) and command.name != self.name:
            return command.commands[str(self.name)]
        return command

    def summary(self) -> str:
        """The docstring of its function, else of its module, read from the source."""
        spec = find_spec(self._module)
        assert spec is not None
        tree = ast.parse(Path(str(spec.origin)).read_text(encoding="utf-8"))
        names = {self.name, f"{self.name}_"}  # `import` and `next` mean something else in Python
        functions = (each for each in tree.body if isinstance(each, ast.FunctionDef) and each.name in names)
        return ast.get_docstring(next(functions, tree)) or ""


class Commands(TyperGroup):
    """All commands of `MODULES`."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        for module, names in MODULES.items():
            for name in names:
                self.add_command(LazyCommand(name, module))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """The page of all commands says of each what it does."""
        for command in self.commands.values():
            if isinstance(command, LazyCommand):
                command.short_help = command.summary()
        super().format_help(ctx, formatter)
