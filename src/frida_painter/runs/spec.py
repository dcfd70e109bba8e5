"""RunSpec: the full description of a painting, with one set of defaults and limits for all interfaces.

Command line, page, TOML files, experiments and notebooks use it. This module loads no tensors.
"""

from collections.abc import Mapping
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import ValidationError, model_validator

from frida_painter import storage
from frida_painter.easel.kinds import HUMAN, NO_CAMERA, SAWYER_SIM, is_simulated
from frida_painter.errors import ConfigError
from frida_painter.objectives.word_settings import USUAL, WordSettings
from frida_painter.planning.settings import FEWEST_FOR_LAYERS
from frida_painter.runs.fields import NAMED_PAINTS, canvas_of, paints_of, sentence_on
from frida_painter.runs.settings import (
    CanvasSettings,
    GoalSettings,
    MachineSettings,
    PaintingSettings,
    PlanSettings,
    setting,
)
from frida_painter.runs.shares import AUTO, brush_shares, family_shares
from frida_painter.storage import count_of

VERSION = 1
SETTLED = ("strokes", "layers", "colors", "canvas", "brushes", "new_paints", "ground", "paints")
"""Settings that a plan depends on; they cannot change once there is a plan."""
USUAL_BRUSHES = "broad:30%,medium:35%,fine:35%"
"""Default brushes of a picture in the virtual studio."""
FEWER_BRUSHES = "broad:50%,medium:50%"
"""Default brushes of a picture with less than 200 strokes, or if drying twice takes a third of the minutes."""
_FEWEST_FOR_ALL = 200  # strokes
WORDS_BRUSHES = "broad:50%,fine:50%"
"""Default brushes of words alone; people recognise a thing by its outline and its small parts."""
FILM_FRAMES = 120
"""Largest number of frames of a film."""
_WORDS = tuple(field.name for field in fields(WordSettings))
_MAX_SPEC_BYTES = 2**20
FORMER = {
    "tilt": 0,
    "sharpness": 0.3,
    "timelapse_frames": FILM_FRAMES,
    "phrases": "{}",
    "initialiser": "growth",
    "listener": None,
    "arm_meshes": None,
}
"""Settings of 0.3 that are fixed now, each with the value that it is fixed at."""


class RunSpec(PaintingSettings, MachineSettings, PlanSettings, CanvasSettings, GoalSettings):
    """Description of a painting. `of`, `from_toml` and `read` raise ConfigError, which names all faults at once.

    Its fields are the settings of its sections; `docs/reference/settings.md` lists them.

        >>> import frida_painter as fp
        >>> spec = fp.RunSpec.of(goal=[{"image": "photo.jpg"}], strokes=50, canvas="A4")
        >>> spec.strokes, str(spec.canvas), spec.seed
        (50, '210 x 297 mm', 0)
    """

    version: Literal[1] = setting(1)
    """Version of these settings in a file."""

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        given = self.model_fields_set
        self._require_words()
        self._require_no_goal()
        if "colors" in given and self.colors > self.strokes:
            raise ValueError(f"{self.colors} colors for {self.strokes} strokes; give at most as many colors as strokes")
        if self.layers is not None and len(self.brush_names) > 1 and self.layers != len(self.brush_names):
            raise ValueError(f"{self.layers} layers and {len(self.brush_names)} brushes; leave out --layers")
        if self.strokes_of is not None and (self.layers is not None or self.brushes == AUTO):
            raise ValueError("--strokes-of adds a layer for each family; leave out --layers, and name the --brushes")
        if self.brushes == AUTO and self.layers is not None:
            raise ValueError(f"--brushes {AUTO} says how many layers there are, and --layers too; leave out one")
        if self.names_brushes and len(self.brush_names) > self.strokes:
            raise ValueError(
                f"{len(self.brush_names)} layers for {count_of(self.strokes, 'stroke')}; give at most as many brushes"
            )
        for name, share in zip(self.brush_names, self.shares or (), strict=False):
            if self.names_brushes and round(self.strokes * share) == 0:
                raise ValueError(
                    f"{name} gets {100 * share:g} % of {count_of(self.strokes, 'stroke')}, which is not one stroke; "
                    "give it a larger share, or leave it out"
                )
        if self.new_paints and self.palette is not None:
            raise ValueError("--palette tells of one palette, and --new-paints mixes one for each layer; leave one out")
        if self.layers is not None and self.layers > self.strokes:
            raise ValueError(f"{self.layers} layers for {self.strokes} strokes; give at most as many layers as strokes")
        if "replans" in given and self.replans >= self.strokes:
            raise ValueError(
                f"{self.replans} replans for {self.strokes} strokes; "
                f"there is a look between strokes only, so give at most {self.strokes - 1}"
            )
        if self.on_canvas and self.ground not in (None, "white"):
            raise ValueError(
                f"--on-canvas paints on what is there, and --ground {self.ground} tones a bare canvas; leave out one"
            )
        if not self.has_camera and (self.replan_policy or ("replans" in given and self.replans)):
            option = f"--replan-policy {self.replan_policy}" if self.replan_policy else f"--replans {self.replans}"
            raise ValueError(
                f"{option} was given, and with --camera {NO_CAMERA} nobody looks at the canvas; leave it out, or name "
                "a camera. A picture that you take counts as a look: frida-painter look FOLDER PICTURE"
            )
        if not self.has_camera and self.on_canvas:
            raise ValueError(
                f"--on-canvas begins on what a camera sees, and with --camera {NO_CAMERA} nobody looks; leave it out "
                "and put up a bare canvas, or name a camera"
            )
        if self.minutes is not None and self.by_hand:
            raise ValueError(f"--minutes is the robot's time, and with --robot {HUMAN} a person paints; leave it out")
        if self.minutes is not None and self._dryings * self.drying >= self.minutes:
            raise ValueError(
                f"--minutes is {self.minutes:g}, and between {self._dryings + 1} layers paint dries for "
                f"{self._dryings * self.drying:g} minutes; give more minutes, fewer brushes or --layers, or less drying"
            )
        return self

    def _require_words(self) -> None:
        """Raises ValueError if settings of words are wrong, or given without words."""
        kinds = {item.kind for item in (*self.goal, *self.initial)}
        if kinds and "text" not in kinds and self.words != USUAL:
            said = zip(_WORDS, astuple(self.words), astuple(USUAL), strict=True)
            option = next(name for name, mine, usual in said if mine != usual)
            raise ValueError(f"--{option} is for words, and the goal has none; leave it out, or give --text")

    def _require_no_goal(self) -> None:
        """Raises ValueError if a painting without a goal has something that only a goal can use."""
        if not self.together:
            return
        useless = {
            "a goal": self.goal or self.initial, "--minutes": self.minutes, "--layers": (self.layers or 1) > 1,
            "--strokes-of": self.strokes_of, "--replan-policy": self.replan_policy,
            "--ground auto": self.ground == AUTO, "--brushes auto": self.brushes == AUTO,
            "several brushes": self.brushes not in (None, AUTO) and len(self.brush_names) > 1,
        }  # fmt: skip
        found = [name for name, value in useless.items() if value]
        if found:
            raise ValueError(
                f"--together paints without a goal, and {found[0]} was given; leave out one of them. With --together, "
                "name one brush, and a ground if you like"
            )
        if not self.has_camera:
            raise ValueError(
                f"--together answers what you paint, and with --camera {NO_CAMERA} nobody sees it; name a camera"
            )

    @classmethod
    def of(cls, **settings: Any) -> Self:
        """Returns a checked description, with defaults that fit the given values.

        These defaults are the canvas of the workspace file, and the number of colours of the palette file. A plan
        with few strokes gets fewer colours and replans.
        Raises ConfigError.
        """
        values = _spell_out(settings)
        try:
            chosen = cls(**values)
        except ValidationError as error:
            raise ConfigError(
                "; ".join(sentence_on(fault, cls.model_fields) for fault in error.errors()) + "."
            ) from error
        for name, value in values.items():
            fault = storage.path_fault(value) if isinstance(value, str | Path) and name != "avoid" else ""
            if fault:
                raise ConfigError(f"{name} was given {str(value)[:40]!r}, which can be no name and no path ({fault}).")
        if chosen.palette is not None and "colors" not in values:
            return cls.of(**values, colors=paints_of(chosen.palette))
        fitting: dict[str, Any] = {
            "colors": min(chosen.colors, chosen.strokes),
            "replans": min(chosen.replans, chosen.strokes - 1) if chosen.has_camera else 0,
        }
        if chosen.workspace is not None and not chosen.simulated and "canvas" not in values:
            fitting["canvas"] = canvas_of(chosen.workspace)
        return chosen.model_copy(
            update={
                name: fits for name, fits in fitting.items() if name not in values and fits != getattr(chosen, name)
            }
        )

    @classmethod
    def from_toml(cls, path: str | Path, **overrides: Any) -> Self:
        """Reads a description from a TOML file, with `overrides`; its file names are relative to it.

        Raises ConfigError.
        """
        path = Path(path)
        values = storage.read_toml(
            path, "a settings file (TOML)", _MAX_SPEC_BYTES, "write lines such as: strokes = 300"
        )
        for name in (*FILES, "paints"):
            if isinstance(values.get(name), str) and values[name] not in NAMED_PAINTS:
                values[name] = path.parent / values[name]
        kept = {name: value for name, value in values.items() if (name, value) not in FORMER.items()}
        return cls.of(**{**kept, **overrides})

    def with_values(self, **settings: Any) -> Self:
        """Returns a checked copy with other values. Raises ConfigError."""
        kept = {name: getattr(self, name) for name in self.model_fields_set}
        return type(self).of(**{**kept, **_spell_out(settings)})

    @property
    def as_kept(self) -> Self:
        """Description with exactly the values that are read again from its folder."""
        return type(self).of(**self.record(), goal=self.goal, initial=self.initial)

    def record(self) -> dict[str, Any]:
        """Returns the description as plain values, without the goal, which is kept beside it."""
        return self.model_dump(mode="json", exclude={"goal", "initial"})

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Reads a description from a painting's folder, if version 0.2 or newer wrote it. Raises ConfigError."""
        path = Path(path)
        content = storage.read_bytes(path, "the settings of a painting", _MAX_SPEC_BYTES, ConfigError)
        try:
            plain = storage.parse_json(content)
            if not isinstance(plain, dict) or not {"strokes", "film", "calibration"} <= set(plain):
                raise KeyError("strokes, film and calibration are needed")
            return cls.of(**upgrade_record(plain))
        except (ValueError, KeyError) as cause:
            raise ConfigError(f"{path} does not hold the settings of a painting ({cause}); bring it back.") from cause

    @property
    def heading(self) -> str:
        """Title, or one from the first goal."""
        usual = "Drawn together" if self.together else "Untitled"
        return self.title or (self.goal[0].title if self.goal else usual)

    @property
    def name(self) -> str:
        """Folder name from the first goal. Raises IndexError if there is no goal, and it is not painted together."""
        return "together" if self.together else self.goal[0].name

    @property
    def goal_facts(self) -> tuple[tuple[str, str], ...]:
        """Goals for page and record, as (label, description)."""
        return (
            *([("Goal", "none: drawn together")] if self.together else []),
            *((item.label, item.described) for item in self.goal),
            *((f"Begun with {item.kind}", item.described) for item in self.initial),
        )

    @property
    def words(self) -> WordSettings:
        """Settings of the words."""
        return WordSettings(self.beginning, self.avoid)

    @property
    def names_brushes(self) -> bool:
        """True if the description names its brushes, instead of leaving them to the defaults or the planner."""
        return self.brushes not in (None, AUTO) or self.strokes_of is not None

    @property
    def layer_brushes(self) -> str:
        """Named brushes, or the default ones, with a layer for each named family, in the form of --brushes."""
        if self.strokes_of is None:
            return self._own_brushes
        families, own = family_shares(self.strokes_of), brush_shares(self._own_brushes)
        left = 1 - sum(share for _, share in families)
        shares = [share for _, share in own]
        usual = (1.0,) if len(own) == 1 else (0.6, *[0.4 / (len(own) - 1)] * (len(own) - 1))
        given = [usual[number] if share is None else share for number, share in enumerate(shares)]
        last = own[-1][0]
        layers = [(name, left * share / sum(given)) for (name, _), share in zip(own, given, strict=True) if left > 1e-9]
        layers += [(f"{last}+{name}", share) for name, share in families]
        return ",".join(f"{name}:{100 * share:.6f}%" for name, share in layers)

    @property
    def _own_brushes(self) -> str:
        """Named brushes, or the default ones; several only if the robot changes brushes itself."""
        if self.brushes is not None and self.brushes != AUTO:
            return self.brushes
        if self.together and self.simulated and self.layers is None:
            return "medium"
        if self.layers is not None or not self.simulated or self.is_short or self.strokes < FEWEST_FOR_LAYERS:
            return "broad"
        if self.is_words:
            return WORDS_BRUSHES
        hurried = self.minutes is not None and self.minutes < 6 * self.drying
        return FEWER_BRUSHES if self.strokes < _FEWEST_FOR_ALL or hurried else USUAL_BRUSHES

    @property
    def _dryings(self) -> int:
        """Number of times that a layer dries before the next one, for the requested layers."""
        return max(len(self.brush_names) if self.names_brushes else 1, self.layers or 1) - 1

    @property
    def is_short(self) -> bool:
        """True if drying once would take more than a third of the robot's time."""
        return self.minutes is not None and self.minutes < 3 * self.drying

    @property
    def is_words(self) -> bool:
        """True if the goal consists of words alone."""
        return bool(self.goal) and not self.initial and all(item.kind == "text" for item in self.goal)

    @property
    def is_composed(self) -> bool:
        """True if the goal is words, alone or with a sketch or a style.

        Painting then begins with things on a ground.
        """
        kinds = {item.kind for item in self.goal}
        return "text" in kinds and not self.initial and kinds <= {"text", "sketch", "style"}

    @property
    def brush_names(self) -> tuple[str, ...]:
        """Brush of all layers, or of each layer: names or weight files."""
        return tuple(name for name, _ in brush_shares(self.layer_brushes))

    @property
    def shares(self) -> tuple[float, ...] | None:
        """Share of the strokes for each layer; None for the default shares."""
        shares = [share for _, share in brush_shares(self.layer_brushes) if share is not None]
        return tuple(shares) if len(shares) > 1 else None

    @property
    def simulated(self) -> bool:
        """True if no real robot moves."""
        return is_simulated(self.robot)

    @property
    def by_hand(self) -> bool:
        """True if a person paints."""
        return self.robot == HUMAN

    @property
    def has_camera(self) -> bool:
        """False if nobody looks at the canvas: the plan is then painted as it is."""
        return self.camera != NO_CAMERA

    @property
    def films_arm(self) -> bool:
        """True if a simulated arm is filmed at work."""
        return self.film and self.robot == SAWYER_SIM

    @property
    def film_length(self) -> int:
        """Number of timelapse frames: 0 by hand, because nobody wants to step aside after every stroke."""
        return min(self.strokes, FILM_FRAMES) if self.film and not self.by_hand else 0


FILES = tuple(name for name, field in RunSpec.model_fields.items() if field.annotation == Path | None)
"""Settings that name files, other than those of the goal."""


def _spell_out(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Returns settings with `brushes` for `brush`, the usual word for one brush. Raises ConfigError for both."""
    values = {**settings}
    if "brush" in values:
        if "brushes" in values:
            raise ConfigError("A brush was given, and brushes as well; give --brushes alone.")
        values["brushes"] = values.pop("brush")
    return values


def upgrade_record(plain: Mapping[str, Any]) -> dict[str, Any]:
    """Returns plain values of a description in the current form. Raises ConfigError for another version."""
    if "version" not in plain:
        raise ConfigError(storage.refuse_first_version("The description of this painting"))
    version = plain["version"]
    if type(version) is not int or version != VERSION:
        raise ConfigError(
            f"The settings are of version {version!r}, and this program reads version {VERSION}; use the program that "
            "the painting was begun with, or a newer one."
        )
    for name, fixed in FORMER.items():
        if plain.get(name, fixed) != fixed:
            raise ConfigError(
                f"The settings say {name} = {str(plain[name])[:20]}, and it is always {fixed} now; use the program "
                "that the painting was begun with, or delete it there and plan anew."
            )
    kept = {name: value for name, value in plain.items() if name not in FORMER}
    return {"ground": "white", "focus": "none", **kept}  # 0.2 may lack these, which were fixed then
