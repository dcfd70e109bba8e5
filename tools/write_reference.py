"""Writes what is made from the program itself: pages of docs/reference/, and types of settings: `make reference`.

The command line is described by its own commands, the settings by the fields of RunSpec, the parts by the registry
and the networks by their catalogue. All of it is checked in, so that people can read it in the repository, and type
checkers see a misspelt setting; tests/docs fails if a file is not what this program writes.
"""

import inspect
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Le, MaxLen
from pydantic import BeforeValidator

import frida_painter
from frida_painter import registry
from frida_painter.brush.kinds import BrushModel, FamilyPart
from frida_painter.easel.kinds import EaselKind
from frida_painter.hardware.kinds import CameraKind, RobotKind
from frida_painter.mixing.recipe import MixerKind
from frida_painter.objectives import weights
from frida_painter.objectives.objective import GoalKind
from frida_painter.planning.planner import PlannerKind
from frida_painter.planning.settings import about, help_of, usual_of
from frida_painter.render.exporter import ExporterKind
from frida_painter.runs.spec import OF_PAINTINGS, RunSpec
from frida_painter.system.storage import megabytes
from frida_painter_cli.commands import all_commands
from frida_painter_words.picture_makers.making import PictureMakerKind

ROOT = Path(__file__).parents[1]
MADE = "<!-- `make reference` writes this page from the program itself. Do not edit it. -->"
_DIM = re.compile(r"\s*\[dim\](.*?)\[/(?:dim)?\]\s*")
_STYLE = re.compile(r"\[/?(?:bold|dim|italic|cyan)?\]")
GROUPS = (
    (registry.ROBOTS, RobotKind, "Robots (`--robot`)", "a `RobotKind`"),
    (registry.EASELS, EaselKind, "Whole easels (`--robot`)", "an `EaselKind`"),
    (registry.CAMERAS, CameraKind, "Cameras (`--camera`)", "a `CameraKind`"),
    (registry.STROKE_MODELS, BrushModel, "Stroke models (`--brush`)", "a `BrushModel`"),
    (registry.STROKE_FAMILIES, FamilyPart, "Stroke families (`--strokes-of`)", "a `FamilyPart`"),
    (registry.OBJECTIVES, GoalKind, "Kinds of goals", "a `GoalKind`"),
    (registry.REPLAN_POLICIES, object, "Replan policies (`--replan-policy`)", "a function of the text after the colon"),
    (registry.PLANNERS, PlannerKind, "Planners (`--planner`)", "a `PlannerKind`"),
    (registry.MIXERS, MixerKind, 'Mixers (`mixer = "NAME"` in a file of paints)', "a `MixerKind`"),
    (registry.EXPORTERS, ExporterKind, "Exporters (`export --to`)", "an `ExporterKind`"),
    (
        registry.PICTURE_MAKERS,
        PictureMakerKind,
        "Picture makers (`--imagine`)",
        "a `PictureMakerKind`",
    ),
)
# Groups of which the project has no part of its own, or whose parts are fetched.
OTHER_GROUPS = (
    (
        registry.ENCODERS,
        "Encoders (`--clip`)",
        "The object is a function of a `torch.device` that returns an `Encoder`: a network that sees pictures and, as "
        "CLIP does, words. A goal chooses it by `--clip NAME`.",
    ),
    (
        registry.PICTURE_LIBRARIES,
        "Picture libraries (`--text`)",
        "The object is a function without arguments that returns a library of pictures of things, from which words "
        "are composed: see `PictureLibrary` in `frida_painter.plugins`.",
    ),
)
PROMISE = """Import what a part needs from one module:

```python
from frida_painter.plugins import GoalKind, Gives, ObjectiveTerm, Term
```

What `frida_painter.plugins` names is a promise. Versions are semantic: a name, its arguments and what it returns \
change only in a major version, and before 1.0 only in a minor one. What is to change or to go works on, with a \
`DeprecationWarning`, for two minor versions before it does. Other modules may change at any time.

Try the parts of a package as the program would use them, without any device:

```sh
frida-painter parts own-parts --example mirror=left-right --example trace=sheet.csv
```

In Python: `fp.plugins.check("own-parts", examples={"mirror": "left-right"})`. A part that raises at import, is of \
another kind, hangs, or returns what the program cannot use is told in one sentence. \
[`own_parts`](../../examples/own_parts) has a part of each kind."""


def command_line() -> str:
    """Every command with its arguments, options and defaults."""
    parts = [
        MADE,
        "# Command line",
        "`frida-painter COMMAND --help` prints the same; for `paint` and `plan`, `--help-all` does. "
        "A command that fails says in one sentence what to do. "
        "Exit status: 0 done, 1 the answer is no (`check`, `doctor`), 2 something has to be mended, "
        "3 the painting has paused and can be resumed, 130 stopped.",
        "\n".join(f"- [`{name}`](#{_anchor(name)}): {_sentence(command)}" for name, command in _top()),
    ]
    for name, command in _top():
        parts += _described(name, command, 2)
    return "\n\n".join(parts) + "\n"


def settings() -> str:
    """Every field of RunSpec: type, limits, default, the option that sets it, and what it is for."""
    options = {option.name: option for option in dict(_top())["paint"].params}
    rows = []
    for section in (*OF_PAINTINGS, RunSpec):
        for name, field in section.model_fields.items():
            if section is RunSpec and name != "version":
                continue
            option = options.get(name)
            flag = ", ".join(f"`{flag}`" for flag in option.opts) if option is not None else ""
            told = f"{_escape(usual_of(field))} | {flag} | {_escape(help_of(field))}"
            rows.append(f"| `{name}` | {_type(field)} | {told} |")
    head = "| setting | value | default | option | what it sets |\n|---|---|---|---|---|"
    return "\n\n".join(
        (
            MADE,
            "# Settings",
            "One painting is described by these settings: as options of `paint`, in a TOML file (`--settings FILE`), "
            "in a sweep file, and as keyword arguments of `RunSpec.of` in Python. A painting's folder keeps them in "
            "`settings.json`.",
            f"{head}\n" + "\n".join(rows),
        )
    ) + "\n"  # fmt: skip


def parts() -> str:
    """What ships with the project in every group that a package of one's own can add to."""
    found = [
        MADE,
        "# Parts and entry points",
        "These parts ship with the project. A package of your own adds to each group with one line of its "
        "`pyproject.toml`, and the same names appear in `--help`, in `doctor` and in error messages.",
        "## What packages may rely on",
        PROMISE,
    ]
    for group, kind, title, given in GROUPS:
        rows = []
        for name, part in registry.parts(group).items():
            if part.is_ours:
                loaded = part.load(kind)
                form = getattr(loaded, "form", "") or getattr(loaded, "option", "") or name
                needed = getattr(loaded, "needed", None)
                install = needed and (f"pip install '.[{needed.extra}]'" if needed.extra else needed.install)
                rows.append(f"| `{form}` | {_about(loaded)} | {f'`{install}`' if install else ''} |")
        head = "| written as | what it is | needs |\n|---|---|---|"
        found += [f"## {title}", f"Group `{group}`; the object is {given}.", *_members(kind)]
        found.append(f"{head}\n" + "\n".join(rows))
    for group, title, told in OTHER_GROUPS:
        found += [f"## {title}", f"Group `{group}`.", told]
    return "\n\n".join(found) + "\n"


def _members(kind: type) -> list[str]:
    """Fields of a kind, from its docstring: one line for each."""
    lines = inspect.cleandoc(kind.__doc__ or "").splitlines() if kind is not object else []
    told: list[str] = []
    for line in lines[1:]:
        if re.match(r"\w+(, \w+)*: ", line):
            name, _, about = line.partition(": ")
            told.append(f"- {', '.join(f'`{one}`' for one in name.split(', '))}: {_escape(about)}")
        elif (told and line.startswith(" ")) or (
            told and line and not line.startswith(("Raises", "The module", "With "))
        ):
            told[-1] += f" {_escape(line.strip())}"
        elif told and line:
            break
    return ["\n".join(told)] if told else []


def networks() -> str:
    """Every network and picture library of the catalogue."""
    rows = [
        f"| `{entry.name}` | {_escape(entry.purpose)} | {megabytes(entry.size)} | {entry.licence} |"
        for entry in weights.all_weights()
    ]
    head = "| name | what for | download | licence |\n|---|---|---:|---|"
    return "\n\n".join(
        (
            MADE,
            "# Networks and picture libraries",
            "`frida-painter models fetch NAME` downloads one of them, `models fetch words` all that words need, and "
            "nothing else downloads any. [Fetch the networks](../how-to/networks.md) says how.",
            f"{head}\n" + "\n".join(rows),
        )
    ) + "\n"  # fmt: skip


def python() -> str:
    """The public names, each with its first sentence and a link to its reference on the site."""
    rows = []
    for name in sorted(frida_painter.__all__, key=str.casefold):
        found = getattr(frida_painter, name)
        if not hasattr(found, "__qualname__"):  # a module, or a plain value
            about = inspect.cleandoc(found.__doc__ or "").partition("\n")[0] if inspect.ismodule(found) else ""
            rows.append(f"| `{name}` | {_escape(about)} |")
            continue
        at = f"{found.__module__}.{found.__qualname__}"
        sentence = " ".join(inspect.cleandoc(found.__doc__ or "").partition("\n\n")[0].split())
        sentence = re.split(r"(?<=[.:;]) ", sentence)[0].rstrip(":;")
        package, inner = at.split(".")[:2]
        room = inner if package == "frida_painter" else package
        rows.append(f"| [`{name}`](api/{room}.md#{at}) | {_escape(sentence)} |")
    head = "| name | what it is |\n|---|---|"
    return "\n\n".join(
        (
            MADE,
            "# Python",
            "`import frida_painter as fp` offers these names. Each leads to its signature and docstring on the site, "
            "which `make docs` builds into `site/`; there every room of the house has a page, too. "
            "[Use it from Python](../how-to/python.md) shows them at work.",
            f"{head}\n" + "\n".join(rows),
        )
    ) + "\n"  # fmt: skip


def setting_types() -> str:
    """The settings by name, with the types that a person may give in Python, for type checkers."""
    rows = []
    for name, field in {**RunSpec.model_fields, "brush": RunSpec.model_fields["brushes"]}.items():
        forms = [one.json_schema_input_type for one in field.metadata if isinstance(one, BeforeValidator)]
        given = forms[0] if forms else field.annotation
        written = given.__name__ if isinstance(given, type) else re.sub(r"\b(?:\w+\.)+(?=\w)", "", str(given))
        rows.append(f"    {name}: {written}".replace("'", '"'))
    head = (
        '"""Settings of a painting by name, in the forms that Python takes; `make reference` writes this file."""\n\n'
        "from collections.abc import Mapping, Sequence\nfrom pathlib import Path\n"
        "from typing import Any, Literal, TypedDict\n\n"
        "from frida_painter.canvas_size import CanvasSize\nfrom frida_painter.runs.goal_item import GoalItem\n\n"
        "class Settings(TypedDict, total=False):\n"
    )
    return head + "\n".join(rows) + "\n"


def _top() -> Iterator[tuple[str, Any]]:
    for entry in all_commands():
        yield entry.name, entry.load()


def _described(name: str, command: Any, level: int) -> Iterator[str]:
    if (deferred := getattr(command, "_entry", None)) is not None:  # its module is imported when it is called
        command = deferred.load()
    yield f"{'#' * level} `{name}`"
    members = getattr(command, "commands", None)
    arguments = [param for param in command.params if param.param_type_name == "argument"]
    usage = " ".join(("frida-painter", name, *(_argument(one) for one in arguments), "[OPTIONS]"))
    if not members:
        yield f"```text\n{usage}\n```"
    yield from _paragraphs(command.help or "")
    if arguments:
        yield "\n".join(f"- `{_argument(one)}`: {_cell(one.help or '')}" for one in arguments)
    panels: dict[str, list[str]] = {}
    for param in command.params:
        if param.param_type_name == "option" and not param.hidden and param.name != "help":
            panels.setdefault(getattr(param, "rich_help_panel", None) or "", []).append(_option(param))
    for panel, rows in panels.items():
        head = f"| {panel or 'option'} | default | what it sets |\n|---|---|---|"
        yield f"{head}\n" + "\n".join(rows)
    for inner, member in (members or {}).items():
        yield from _described(f"{name} {inner}", member, level + 1)


def _option(param: Any) -> str:
    flags = ", ".join(f"`{flag}`" for flag in (*param.opts, *param.secondary_opts))
    kind = getattr(getattr(param, "type", None), "name", "value")
    metavar = "" if param.is_flag else f" `{param.metavar or kind.upper()}`"
    told = _DIM.search(param.help or "")
    default = told[1] if told else ""
    if not told and param.show_default and param.default is not None and not param.is_flag:
        default = str(param.default)
    if not told and param.is_flag and param.secondary_opts and param.default is not None:
        default = (param.opts if param.default else param.secondary_opts)[0].lstrip("-")
    return f"| {flags}{_escape(metavar)} | {_escape(default)} | {_cell(param.help or '')} |"


def _argument(param: Any) -> str:
    name = (param.metavar or param.name.upper()).strip("[]{}")
    return name if param.required else f"[{name}]"


def _sentence(command: Any) -> str:
    return _escape(" ".join((command.help or "").partition("\n\n")[0].split()))


def _paragraphs(text: str) -> Iterator[str]:
    for paragraph in text.strip().split("\n\n"):
        yield _link(_escape(_STYLE.sub("", " ".join(paragraph.split()))))


def _link(text: str) -> str:
    return re.sub(r"docs/((?:[\w-]+/)*)([\w-]+)\.md", r"[\2](../\1\2.md)", text)


def _cell(text: str) -> str:
    return _link(_escape(" ".join(_STYLE.sub("", _DIM.sub("", text)).split())))


def _escape(text: str) -> str:
    return text.replace("|", r"\|").replace("<", "&lt;")


def _anchor(name: str) -> str:
    return name.replace(" ", "-")


def _about(part: Any) -> str:
    words = next((getattr(part, name) for name in ("title", "help") if getattr(part, name, "")), "")
    if not words and (kind := getattr(part, "kind", None)) is not None:
        low, high = (round(1000 * end) for end in kind.limits.length)
        words = f"strokes of {low} to {high} mm, at most {1000 * kind.width:.0f} mm wide"
    owner = getattr(part, "__self__", part)  # of a class's method, the class
    return _escape(words or (owner.__doc__ or "").strip().partition("\n")[0].partition(". ")[0])


def _type(field: Any) -> str:
    limits = [one for one in field.metadata if isinstance(one, Ge | Le | MaxLen)]
    low = next((one.ge for one in limits if isinstance(one, Ge)), None)
    high = next((one.le for one in limits if isinstance(one, Le)), None)
    wanted = field.annotation
    inner = [one for one in get_args(wanted) if one is not NoneType]
    if get_origin(wanted) in (Union, UnionType) and len(inner) == 1:
        wanted = inner[0]
    if get_origin(wanted) is Literal:
        return " or ".join(f"`{value}`" for value in get_args(wanted))
    name = {int: "whole number", float: "number", bool: "true or false", str: "text"}.get(wanted, "")
    name = name or about(field)["value"] or "text"
    span = f", {low:g} to {high:g}" if low is not None and high is not None else ""
    return _escape(name + (span or (f", at least {low:g}" if low is not None else "")))


def main() -> None:
    """Writes the files, or with --show prints them by their names, as JSON."""
    if sys.argv[1:2] == ["--show"]:
        json.dump({name: made() for name, made in PAGES.items()}, sys.stdout)
        return
    for name, made in PAGES.items():
        (ROOT / name).write_text(made(), encoding="utf-8")


PAGES = {
    "docs/reference/command-line.md": command_line,
    "docs/reference/settings.md": settings,
    "docs/reference/parts.md": parts,
    "docs/reference/networks.md": networks,
    "docs/reference/python.md": python,
    "src/frida_painter/runs/setting_types.pyi": setting_types,
}


if __name__ == "__main__":
    main()
