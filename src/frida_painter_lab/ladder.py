"""Experiment: the steps at which a painting loses quality, and the gain without each cause.

The ladder leads from the plan to the painting. Every rung is the same first plan, in the same studio, with one
change. Paintings are judged by their true colours, not by the camera. Separate rungs show the gain of replanning and
the gain of a known placement.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

from torch import Tensor

from frida_painter import images
from frida_painter.plan import Plan
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.spec import RunSpec
from frida_painter_lab.comparison import Comparison, PaintingWay, Scene
from frida_painter_lab.measures import psnr
from frida_painter_lab.paintings import (
    CAMERA,
    IMPERFECTIONS,
    PLACEMENT,
    Painted,
    StudioRun,
    Tell,
    make_first_plan,
)
from frida_painter_lab.targets import Target

BLIND, KNOWN, USUAL = "without a look", "placement known, no look", "with 4 looks"
SIMILARITY, PLANNED, EXPECTED = "PSNR, dB", "of the plan as rendered", "of the plan as expected"


def _rung(name: str, than: str, looks: int = 0, without: Sequence[object] = ()) -> PaintingWay:
    return PaintingWay(name, than, changes={"replans": looks}, without=tuple(without))  # type: ignore[arg-type]


RUNGS = (
    _rung(BLIND, ""),
    _rung("with 1 look", BLIND, 1),
    _rung(USUAL, BLIND, 4),
    _rung("with 12 looks", BLIND, 12),
    _rung(KNOWN, BLIND, 0, [PLACEMENT]),
    _rung("placement known, 4 looks", KNOWN, 4, [PLACEMENT]),
    _rung("placement known, 12 looks", KNOWN, 12, [PLACEMENT]),
    *(
        _rung(f"placement known, no {one.name}", KNOWN, 0, [PLACEMENT, one])
        for one in IMPERFECTIONS
        if one not in (PLACEMENT, CAMERA)
    ),
    _rung(f"{USUAL}, no {CAMERA.name}", USUAL, 4, [CAMERA]),
    _rung("no imperfection, no look", KNOWN, 0, IMPERFECTIONS),
)


@dataclass(frozen=True, kw_only=True)
class Ladder(Comparison):
    """Experiment `ladder`: every photograph planned once per seed, and that plan painted on every rung.

    strokes: of a painting
    made: first plans and their pictures by photograph and seed, which all rungs of a process share
    """

    NAME = "ladder"
    TITLE = "Where the quality of a painting is lost"
    SHARING = "painted"
    FULL = RunSpec.of(strokes=200, colors=12, replans=0)
    QUICK = RunSpec.of(strokes=14, colors=3, render_height=64, effort=0.05, replans=0)
    MEASURES: ClassVar[Mapping[str, bool | None]] = {SIMILARITY: True, PLANNED: None, EXPECTED: None}
    SHOWN = ("canvas",)
    COLUMNS = 5

    photos: tuple[Target, ...]
    strokes: int | None = None
    made: dict[tuple[str, str], tuple[Plan, Tensor]] = field(default_factory=dict, compare=False, repr=False)

    def scenes(self) -> Sequence[Scene]:
        """Returns the photographs."""
        return [(photo,) for photo in self.photos]

    def ways(self) -> Sequence[PaintingWay]:
        """Returns the rungs."""
        more = {"strokes": self.strokes} if self.strokes else {}
        return [replace(rung, changes={**rung.changes, **more}) for rung in RUNGS]

    def make_plan(self, run: StudioRun, opened: PaintingRun, tell: Tell) -> tuple[Plan, Tensor]:
        """Returns the first plan of the photograph and seed, made once."""
        whose = run["target"], run["seed"]
        if whose not in self.made:
            self.made[whose] = make_first_plan(opened, tell)
        return self.made[whose]

    def figures(self, painted: Painted, picture: Tensor, *scene: Target) -> Mapping[str, float]:
        """Measures the true canvas and the plan beside the photograph."""
        wanted, planner = images.fit(scene[0].picture, *painted.planned.shape[1:]), painted.run.planner
        forecast = planner.forecast(painted.plan, planner.bare)
        assert forecast is not None  # the goal is a photograph
        return {
            SIMILARITY: psnr(painted.truth, wanted),
            PLANNED: psnr(painted.planned, wanted),
            EXPECTED: forecast.expected,
        }
