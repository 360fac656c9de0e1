"""The commands there are. Each is imported when it is used: the help of all needs nothing that they work with."""

from __future__ import annotations

import ast
import gc
import importlib
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from rigctl.cli import io

MODULES = {
    "demo": ("demo",),
    "campaigns": ("run", "resume"),
    "steering": ("pause", "abort", "answer", "status", "mark"),
    "results": ("result",),
    "report": ("report",),
    "certificate": ("certificate", "sign", "verify"),
    "history": ("history",),
    "noise": ("noise",),
    "workbench": ("compare", "diagnose", "fit"),
    "model": ("model",),
    "planning": ("next", "investigate"),
    "effects": ("effects",),
    "exchange": ("import", "export"),
    "simulate": ("simulate",),
    "check": ("check",),
    "instruments": ("stop", "home", "move"),
    "wire": ("wire", "replay"),
    "console": ("console",),
    "completion": ("completion",),
    "manual": ("man",),
}
"""Commands by the module of this package whose Typer application `app` has them, in the order of the help."""


class LazyCommand(TyperCommand):
    """A command, or a group of them, whose module is not imported yet."""

    def __init__(self, name: str, module: str) -> None:
        super().__init__(name)
        self._module = f"{__package__}.{module}"

    def make_context(self, info_name: str | None, args: list[str], *parent: Any, **extra: Any) -> Any:
        """Click's first call of a command that is used: from here on the one in the module acts."""
        # Help is read from the source: the modules that commands work with take seconds to import.
        if "--help" in args:
            with self.declared().make_context(info_name, list(args), *parent, **extra) as context:
                context.command.invoke(context)  # leaves with the help; does nothing where "--help" is some value
        return self.imported().make_context(info_name, args, *parent, **extra)

    def imported(self) -> Any:
        """The command in its module."""
        module = importlib.import_module(self._module)
        _collect_no_module()
        gc.enable()
        return self._command_of(module)

    def declared(self) -> Any:
        """The command with its arguments and options but without what it does, read from the source."""
        module, tree = ModuleType(self._module), _tree(self._module)
        tree.body = [_without_body(each) for each in tree.body if not _of_the_work(each)]
        exec(compile(tree, self._module, "exec"), module.__dict__)  # noqa: S102 - the declarations of this package
        return self._command_of(module)

    def summary(self) -> str:
        """The docstring of its function, else of its module, read from the source."""
        told = _docstrings(self._module)
        # `import` and `next` mean something else in Python.
        return told.get(str(self.name)) or told.get(f"{self.name}_") or told[""]

    def _command_of(self, module: ModuleType) -> Any:
        command = get_command(module.app)
        # An application with one command is that command; with more it is a group.
        if isinstance(command, TyperGroup) and command.name != self.name:
            return command.commands[str(self.name)]
        return command


@cache
def _collect_no_module() -> None:
    """Once: a process that runs several commands has garbage by the second."""
    gc.freeze()


def _tree(module: str) -> ast.Module:
    spec = find_spec(module)
    assert spec is not None
    return ast.parse(Path(str(spec.origin)).read_text(encoding="utf-8"))


@cache
def _docstrings(module: str) -> dict[str, str]:
    """Of the functions of a module, and its own under ""."""
    tree = _tree(module)
    functions = [each for each in tree.body if isinstance(each, ast.FunctionDef)]
    return {each.name: ast.get_docstring(each) or "" for each in functions} | {"": ast.get_docstring(tree) or ""}


def _of_the_work(statement: ast.stmt) -> bool:
    """Whether it is what commands work with: a class, or an import of this program but what declares arguments."""
    return isinstance(statement, ast.ClassDef) or (
        isinstance(statement, ast.ImportFrom)
        and str(statement.module).split(".")[0] in ("rigctl", "drivers")
        and (statement.module != io.__name__)
    )


def _without_body(statement: ast.stmt) -> ast.stmt:
    if isinstance(statement, ast.FunctionDef):
        # The docstring is the help; the rest of the function would need what was not imported.
        statement.body = [ast.Expr(ast.Constant(ast.get_docstring(statement) or ""))]
        ast.fix_missing_locations(statement)
    return statement


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
