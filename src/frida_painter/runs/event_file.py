"""Listeners of a painting: functions that hear its events, by name; ours write them to a file."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import get_args

from frida_painter import registry
from frida_painter.errors import ConfigError, PluginError, StorageError
from frida_painter.session.events import Event, Notify, Written, record


@dataclass(frozen=True)
class ListenerKind:
    """Listener that a painting is given by its name.

    name: as in `--listener NAME:TEXT`
    help: one sentence
    open: returns the function that hears every event, from the text after the colon; raises ConfigError
    """

    name: str
    help: str
    open: Callable[[str], Notify]


def open_listener(text: str) -> Notify:
    """Returns the listener "NAME" or "NAME:TEXT". Raises ConfigError if there is none, PluginError if it is broken."""
    name, _, argument = text.partition(":")
    known = registry.parts(registry.LISTENERS)
    if name not in known:
        raise ConfigError(f"There is no listener called {name[:40]!r}; there are {', '.join(known)}.")
    heard = known[name].load(ListenerKind).open(argument)
    if not callable(heard):
        raise PluginError(f"The listener {name!r} opened a {type(heard).__name__}, and it is a function; mend it.")
    return heard


def _open_file(path: str) -> Notify:
    """Returns a listener that appends each written event to a file, as one line of JSON."""
    if not path:
        raise ConfigError("The listener events was given no file; write events:FILE.")

    def hear(event: Event) -> None:
        if isinstance(event, get_args(Written)):
            try:
                with Path(path).open("a", encoding="utf-8") as lines:
                    lines.write(json.dumps(record(event)) + "\n")
            except OSError as error:
                raise StorageError(f"{path} cannot be written ({error.strerror}); give another file.") from error

    return hear


EVENTS = ListenerKind("events", "Appends each event to a file, as one line of JSON.", _open_file)
