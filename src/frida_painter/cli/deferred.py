"""Commands that are listed by name and one sentence, and whose module is imported only when one of them is called."""

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_group


@dataclass(frozen=True)
class Deferred:
    """A command or a group of commands: its name, the module whose `register(app)` adds it, and the help of its list.

    help: the first paragraph of the command's own help, word for word; a test compares them.
    """

    name: str
    module: str
    help: str

    def load(self) -> Any:
        """The command itself, with its options; imports its module."""
        app = typer.Typer(callback=nothing_first, rich_markup_mode="rich")
        import_module(self.module).register(app)
        return get_group(app).commands[self.name]


def group_of(entries: tuple[Deferred, ...]) -> type[TyperGroup]:
    """A group whose commands are those entries, in that order: for `typer.Typer(cls=...)`."""

    class DeferredGroup(TyperGroup):
        def __init__(self, **settings: Any) -> None:
            super().__init__(**settings)
            self.commands = {entry.name: _DeferredCommand(entry) for entry in entries}

    return DeferredGroup


def nothing_first() -> None:
    """Done before every command; that there is something keeps a single command's name."""


class _DeferredCommand(TyperCommand):
    """Stands in a list of commands, and hands over to the command itself when that is called."""

    def __init__(self, entry: Deferred) -> None:
        super().__init__(name=entry.name, help=entry.help, rich_markup_mode="rich")
        self._entry = entry

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        return self._entry.load().make_context(info_name, args, parent, **extra)
