"""Pictures made from words before a painting: the options of `paint` and `plan`, and the choice at the terminal."""

import sys
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

from frida_painter import registry
from frida_painter.errors import ConfigError, Interrupted, MakingFailed, PluginError
from frida_painter.planning.settings import SettingSection, setting
from frida_painter.runs.spec import GoalSettings, RunSpec
from frida_painter.system.operating_system import forget_keys
from frida_painter_cli.stop_signal import stop_on_signals

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.loading import EncoderRegistry

_imagine = registry.Later("frida_painter_words.picture_makers.making:imagine")
_make_pictures = registry.Later("frida_painter_words.picture_makers.making:make_pictures")
_MakingWish = registry.Later("frida_painter_words.picture_makers.making:MakingWish")
_FOLDER = Path("paintings") / "imagined"
_WITHOUT = "go on without it by --beginning scene, or --beginning colors with a CLIP"


class ImaginingSettings(SettingSection):
    """Pictures that are made from words before a painting; no description keeps these settings."""

    panel: ClassVar[str] = GoalSettings.panel

    imagine: str | None = setting(
        None,
        value="NAME:TEXT",
        usual="diffusers, if `models fetch imagine` got it, for words without --beginning",
        of=(registry.PICTURE_MAKERS,),
    )
    """Make a picture from the words first, and paint that: of --init-text if it is given, else of --text; for example
    diffusers:FOLDER, command:PROGRAM, http:URL."""
    imagine_pictures: int = setting(4, ge=1, le=16)
    """Number of pictures that are made, each with a seed of its own, to choose from."""
    imagine_minutes: float = setting(30.0, ge=0, le=1440)
    """Minutes that --imagine may take for all its pictures."""


def usual_maker(spec: RunSpec) -> str | None:
    """Returns the fetched maker if it makes the first picture of words; None if none is here, or is wanted.

    It is wanted for words without another picture to begin with, unless the description says how to begin them.
    """
    kinds = {item.kind for item in spec.goal}
    free = spec.beginning == "auto" and spec.pictures is None
    free = free and all(item.kind == "text" for item in spec.initial)
    is_wanted = free and {"text"} <= kinds <= {"text", "style"} and registry.are_here(registry.IMAGINE)
    return "diffusers" if is_wanted else None


def imagine_beginning(spec: RunSpec, given: Mapping[str, Any], *, asked: bool, paints: bool) -> RunSpec:
    """Returns the description, with made pictures in place of words if a maker was named or fetched.

    given: options by name
    asked: True if a person at the terminal chooses among several pictures
    paints: True if the description is painted, False if it is only planned
    Raises MakingFailed, Interrupted after a signal, and the errors of `PaintingRun`, as far as they are known before.
    """
    names = [name for name in ImaginingSettings.model_fields if given.get(name) is not None]
    wanted = ImaginingSettings.of(**{name: given[name] for name in names})
    maker = (named := wanted.imagine) or usual_maker(spec)
    if maker is None and names:
        raise ConfigError(
            f"--{names[0].replace('_', '-')} was given without --imagine, which names a maker; give both, or fetch one "
            "with `frida-painter models fetch imagine` and leave out --beginning and --pictures."
        )
    if maker is None:
        return spec
    from frida_painter.runs.goal_item import name_of
    from frida_painter.runs.goals import open_goal
    from frida_painter.runs.settle import open_networks

    now = f"{datetime.now():%Y%m%d-%H%M%S}"
    with stop_on_signals(
        ("Ending the making of pictures.", "The making is being ended; a third Ctrl-C ends all.")
    ) as stop:

        def heed() -> None:
            if stop.asked:
                raise Interrupted("You stopped before any picture was made, and nothing was painted.")

        encoders = open_networks(spec, _tell, heed)
        if named is None:
            open_goal(spec)  # refuses words that the generator cannot read either
            _tell(f"A picture is made from the words first, by the fetched generator; {_WITHOUT}.")
        _check(spec, given.get("out"), encoders, paints=paints)

        def make(words: str, number: int) -> Path:
            try:
                wish = _MakingWish(words, maker, wanted.imagine_pictures, wanted.imagine_minutes)
                place = _FOLDER / f"{name_of(words)}-{now}-{number}"
                making = _make_pictures(wish, place, spec, stop_asked=lambda: stop.asked, tell=_tell, encoders=encoders)
            except (MakingFailed, PluginError, ConfigError) as fault:
                if named is not None:
                    raise
                raise type(fault)(f"{str(fault).rstrip('.')}; or {_WITHOUT}.") from fault
            return choose_picture(making, input if asked and sys.stdin.isatty() else None)

        replaced: RunSpec = _imagine(spec, make, encoders)
        return replaced


def _check(spec: RunSpec, out: Path | None, encoders: "EncoderRegistry", *, paints: bool) -> None:
    """Raises what a painting of made pictures would raise at its beginning, before time is spent on making them."""
    import torch

    from frida_painter.runs.run import PaintingRun
    from frida_painter.system import images, storage

    if out is not None:
        storage.require_unused(out)
    with TemporaryDirectory() as place:
        anything = Path(place) / "picture.png"
        images.save(torch.linspace(0, 1, 64).expand(3, 64, 64), anything)
        painted = _imagine(spec, lambda words, number: anything, encoders)
        if spec.clip is not None:
            encoders.clip()  # it is of use at least to choose among made pictures
        PaintingRun(painted, out, encoders=encoders).check(paints=paints)


def choose_picture(making: Any, ask: Callable[[str], str] | None) -> Path:
    """Tells the pictures, and returns the file of the chosen one.

    ask: shows a prompt and returns the typed line. None: nobody is asked, and the best one by the making's rule is
    taken
    Raises Interrupted if the person leaves.
    """
    _tell(f"Made from {making.words!r} by {making.made_by}:")
    for number, one in enumerate(making.pictures, 1):
        _tell(f"  {number}  {one.file}  (seed {one.seed})")
    count, best = len(making.pictures), making.best + 1
    if ask is None or count == 1:
        _tell(f"Picture {best} is painted, because {making.rule}.")
        return making.choose(making.best, making.rule)
    prompt = f"Look at them, and type the number of the one to paint, or press Enter for {best} ({making.rule}): "
    forget_keys(sys.stdin)
    while True:
        try:
            line = ask(prompt).strip()
        except (EOFError, KeyboardInterrupt) as end:
            raise Interrupted(f"Nobody chose a picture, and nothing was painted; they are in {making.folder}.") from end
        if not line:
            return making.choose(making.best, making.rule)
        if line.isdecimal() and 1 <= int(line) <= count:
            return making.choose(int(line) - 1, "a person chose it")
        prompt = f"Type a number from 1 to {count}, or press Enter for {best}: "


def _tell(sentence: str) -> None:
    print(sentence, file=sys.stderr)
