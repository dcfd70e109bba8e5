"""What a painting was begun with, kept in its folder: settings, copies of the pictures, and what else decides."""

import hashlib
import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from frida_painter import storage
from frida_painter.cli.real import Site
from frida_painter.config import PaintingSettings
from frida_painter.errors import ConfigError, StorageError
from frida_painter.runs import goals
from frida_painter.session.names import HUMAN

SETTINGS = "settings.json"
GOAL = "goal"
_MOST_BYTES = 2**20
_TIMELAPSE_FRAMES = 120


@dataclass(frozen=True)
class Kept:
    """How a painting is painted, beside its goal.

    calibration: the easel's record, None for the virtual studio's own; placement_error: as it was given
    on the command line; film: whether it is filmed; site: where; arm_meshes: the folder of shapes in which a
    simulated arm is seen in its film.
    """

    settings: PaintingSettings
    calibration: Path | None
    placement_error: str | None
    film: bool
    site: Site = field(default_factory=Site)
    arm_meshes: Path | None = None

    @property
    def timelapse_frames(self) -> int:
        """How many pictures the film gets: none by hand, for nobody wants to step aside after every stroke."""
        return min(self.settings.strokes, _TIMELAPSE_FRAMES) if self.film and self.site.robot != HUMAN else 0

    def write(self, folder: Path) -> None:
        """Puts it into the folder, for people to read. Raises StorageError."""
        storage.write_text(folder / SETTINGS, json.dumps(self.plain(), indent=2) + "\n")

    def plain(self) -> dict[str, Any]:
        """As plain values."""
        return {
            **self.settings.model_dump(mode="json"),
            "calibration": str(self.calibration.resolve()) if self.calibration else None,
            "placement_error": self.placement_error,
            "film": self.film,
            "arm_meshes": str(self.arm_meshes.resolve()) if self.arm_meshes else None,
            **self.site.plain(),
        }

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Reads it, whoever has changed it in the meantime. Raises ConfigError naming every fault."""
        path = folder / SETTINGS
        content = storage.read_bytes(path, "the settings of a painting", _MOST_BYTES, ConfigError)
        try:
            plain = json.loads(content)
            calibration, placement_error, film = (
                plain.pop(name) for name in ("calibration", "placement_error", "film")
            )
            site, meshes = Site.take(plain), plain.pop("arm_meshes", None)
            if not isinstance(film, bool) or not all(
                isinstance(it, str | None) for it in (calibration, placement_error, meshes)
            ):
                raise ConfigError(
                    f"{path}: film is true or false, calibration, placement_error and arm_meshes are texts or null."
                )
        except (ValueError, KeyError, AttributeError, RecursionError) as cause:
            raise ConfigError(f"{path} does not hold the settings of a painting ({cause}); bring it back.") from cause
        settings = PaintingSettings.of(**plain)
        return cls(
            settings,
            Path(calibration) if calibration else None,
            placement_error,
            film,
            site,
            Path(meshes) if meshes else None,
        )

    def rests_on(self, folder: Path) -> dict[str, str]:
        """Hashes of all files that decide how it is painted, by what they are. Raises StorageError."""
        brush = Path(self.settings.brush)
        files = {
            "goal": folder / GOAL,
            "calibration record": self.calibration,
            "workspace": self.site.workspace,
            "brush": brush if brush.suffix else None,
        }
        return {what: "none" if path is None else _hash(path) for what, path in files.items()}


def as_read_again(settings: PaintingSettings) -> PaintingSettings:
    """The settings as they will be read from the folder: to the last digit those that it is begun with."""
    return PaintingSettings.of(**settings.model_dump(mode="json"))


def keep_goal(wanted: goals.Wanted, folder: Path) -> None:
    """Copies the pictures of a goal into the folder, and how they matter. Raises StorageError."""
    lines: list[str] = []
    number = 0
    for table, wishes in (("goal", wanted.wishes), ("initial", wanted.begins)):
        for kind, value, weight in wishes:
            number += 1
            if isinstance(value, Path):
                copy = Path(str(number), value.name)
                _copy(value, folder / GOAL / copy)
                value = copy.as_posix()
            lines += [f"[[{table}]]", f"{kind} = {json.dumps(value, ensure_ascii=False)}", f"weight = {weight!r}", ""]
    storage.write_text(folder / GOAL / "goal.toml", "\n".join(lines))


def read_goal(folder: Path) -> goals.Wanted:
    """The goal as it was kept. Raises ConfigError and ImageError."""
    return goals.read_goal(None, {"goal": folder / GOAL / "goal.toml"})


def _quoted(text: str) -> str:
    """As a TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _copy(source: Path, copy: Path) -> None:
    try:
        with storage.replacing(copy) as temporary:
            shutil.copyfile(source, temporary)
    except OSError as error:
        raise storage.cannot_write(copy, error) from error


def _hash(path: Path) -> str:
    """sha256 over a file, or over the names and contents of all files in a folder; "gone" where it is."""
    content = hashlib.sha256()
    try:
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.is_file():
                content.update(str(file.relative_to(path)).encode() + b"\0" + file.read_bytes())
    except FileNotFoundError:
        return "gone"
    except OSError as error:
        raise StorageError(f"{path} cannot be read ({error.strerror}); it decides how the painting goes on.") from error
    return content.hexdigest()
