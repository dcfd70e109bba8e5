"""Comparison of an object with a protocol: its members, and whether its functions take what the protocol gives."""

import inspect
from typing import Any, Generic, Protocol

from frida_painter.errors import FridaError, PluginError


def require_like(made: object, protocol: type[Any], what: str, error: type[FridaError] = PluginError) -> None:
    """Raises `error` unless an object has all members of a protocol, and its functions take what the protocol gives.

    what: subject of the sentence, such as "Its driver"
    """
    for name in _members(protocol):
        declared = inspect.getattr_static(protocol, name, None)
        is_function = inspect.isfunction(declared)
        try:
            found = getattr(made, name)
        except AttributeError as lack:
            called = f"{name}{_arguments(declared)}" if is_function else name
            raise error(f"{what} has no {called}; {protocol.__name__} of frida_painter.plugins has it.") from lack
        if is_function and not takes(found, declared):
            raise error(
                f"{what} has a {name} that cannot be called as {name}{_arguments(declared)}; give it these arguments, "
                f"as {protocol.__name__} of frida_painter.plugins does."
            )


def _members(protocol: type[Any]) -> list[str]:
    """Returns the names of all members of a protocol, in the order in which they are declared."""
    bases = [base for base in reversed(protocol.__mro__) if base not in (object, Generic, Protocol)]
    names = dict.fromkeys(name for base in bases for name in (*inspect.get_annotations(base), *vars(base)))
    return [name for name in names if not name.startswith("_") or name == "__call__"]


def _arguments(declared: Any) -> str:
    return f"({', '.join([*inspect.signature(declared).parameters][1:])})"


def takes(found: Any, declared: Any) -> bool:
    """Returns True if `found` can be called with all arguments of `declared` but the first, which is `self`."""
    given = [*inspect.signature(declared).parameters.values()][1:]
    named = {one.name: None for one in given if one.kind is one.KEYWORD_ONLY}
    if not callable(found):
        return False
    try:
        inspect.signature(found).bind(*[None] * (len(given) - len(named)), **named)
    except TypeError:
        return False
    except ValueError:  # a compiled function does not tell
        return True
    return True
