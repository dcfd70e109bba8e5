"""What film and page are made of, kept while the painting is made: for another process to go on, or to begin anew."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from torch import Tensor

from frida_painter import images, storage
from frida_painter.errors import ImageError, StorageError
from frida_painter.report.story import Look, Phase

SKETCHBOOK = "sketchbook"
_STORY = "story.json"


class Sketchbook:
    """A folder within the painting's, for timelapse frames, looks and phases. Raises StorageError where it is full."""

    def __init__(self, painting: Path) -> None:
        self._folder = painting / SKETCHBOOK

    def keep_timelapse_frame(self, stroke: int, picture: Tensor) -> None:
        """Keeps the picture [3, H, W] of the timelapse after a stroke."""
        images.save(picture, self._folder / f"glimpse-{stroke:06d}.jpg")

    def timelapse_frames(self, painted: int) -> Iterator[tuple[int, Tensor]]:
        """The timelapse frames up to stroke `painted` with their strokes, in order; damaged ones are left out."""
        for path in sorted(self._folder.glob("glimpse-*.jpg")):
            stroke = int(path.stem.removeprefix("glimpse-"))
            if stroke <= painted:
                try:
                    yield stroke, images.load(path)
                except ImageError:
                    continue

    def keep_story(self, looks: Sequence[Look], phases: Sequence[Phase], expected_seconds: float | None) -> None:
        """Keeps what the page tells of looks and planning so far, and how long the robot was to take in all."""
        told = {
            "looks": [asdict(look) for look in looks],
            "phases": [asdict(phase) for phase in phases],
            "expected_seconds": expected_seconds,
        }
        storage.write_json(self._folder / _STORY, told)

    def story(self) -> tuple[list[Look], list[Phase], float | None]:
        """The looks, the phases and the time as they were kept; none where they are lost."""
        try:
            told = storage.read_json(self._folder / _STORY, "the story so far")
            looks = [Look(**look) for look in told["looks"]]
            phases = [Phase(phase["name"], tuple(map(tuple, phase["loss"]))) for phase in told["phases"]]
        except (StorageError, KeyError, TypeError):
            return [], [], None
        return looks, phases, told.get("expected_seconds")
