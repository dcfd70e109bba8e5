"""A real robot as a person names it: "xarm:192.168.1.10", or "gcode:/dev/ttyUSB0,homing=yes"."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

from frida_painter.errors import ConfigError

Value = TypeVar("Value")
Default = TypeVar("Default")


@dataclass(frozen=True)
class MachineName:
    """A machine as it was named: its kind, where it is, and what else was said of it.

    form: how machines of its kind are named, for messages.
    """

    kind: str
    where: str
    options: Mapping[str, str]
    form: str = ""

    @classmethod
    def of(cls, text: str, form: str = "") -> "MachineName":
        """Reads "kind:where,name=value". Raises ConfigError."""
        named, *parts = text.split(",")
        kind, _, where = named.partition(":")
        options = {}
        for part in parts:
            name, equals, value = part.partition("=")
            if not (equals and name.strip() and value.strip()) or name.strip() in options:
                raise ConfigError(
                    f"{part[:40]!r} in {text[:80]!r} is not understood; write name=value, each name once."
                )
            options[name.strip()] = value.strip()
        return cls(kind.strip(), where.strip(), options, form)

    def choose(self, name: str, read: Callable[[str], Value], default: Default) -> Value | Default:
        """An option as `read` understands it. Raises ConfigError where it does not."""
        if name not in self.options:
            return default
        try:
            return read(self.options[name])
        except (ValueError, KeyError) as error:
            raise ConfigError(f"{name}={self.options[name][:40]} is not understood; write {self.form}.") from error

    def require(self, *known: str, where: bool = True) -> None:
        """Raises ConfigError where something is said that this kind does not know, or not where it is."""
        strangers = sorted(set(self.options) - set(known))
        if strangers:
            raise ConfigError(f"{self.kind} does not know {', '.join(strangers)}; write {self.form}.")
        if where and not self.where:
            raise ConfigError(f"{self.kind!r} was given without where it is; write {self.form}.")


def yes_or_no(text: str) -> bool:
    """What "yes" and "no" mean, for `MachineName.choose`. Raises KeyError."""
    return {"yes": True, "no": False}[text]
