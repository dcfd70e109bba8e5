"""Conformance of parts: each registered part of a package is loaded and tried as the program would use it.

Each trial runs in a thread with a deadline, so that a part that hangs is a finding and not a program that hangs. No
device is connected to. A trial that ends with an error of this project counts as a refusal in a sentence.
"""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.brush.kinds import BrushModel, FamilyPart, require_stroke_model
from frida_painter.canvas_size import CanvasSize
from frida_painter.easel.kinds import EaselKind
from frida_painter.errors import ConfigError, FridaError, MakingFailed, PluginError
from frida_painter.frames import PixelGrid
from frida_painter.hardware import robot
from frida_painter.hardware.easel import PersonStroke
from frida_painter.hardware.kinds import CameraKind, MachineName, RobotKind
from frida_painter.mixing import Finish
from frida_painter.mixing.paint import usual_paints
from frida_painter.mixing.recipe import MixerKind
from frida_painter.objectives.encoders.base import Encoder, PictureLibrary, Reader
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Gives, Goal, GoalKind, ObjectiveContext, require_objective
from frida_painter.planning.planner import Planner, PlannerKind, PlanningTask
from frida_painter.planning.settings import PlannerSettings
from frida_painter.render.exporter import ExporterKind
from frida_painter.session.rehearsal import FlatbedWorkspace
from frida_painter.session.replan_policy import CanvasSeen, ReplanPolicy
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Plan
from frida_painter.strokes.strokes import StrokeLimits, Strokes
from frida_painter.system import images
from frida_painter.virtual.bristles import find_brush
from frida_painter.virtual.robot import Arm
from frida_painter.virtual.studio import ArmAndTable, StudioArm
from frida_painter_together.policies import TurnAnswer, TurnPolicy, TurnTaken
from frida_painter_words.picture_makers.making import PictureMaker, PictureMakerKind, PictureRequest

_PREFIX = "frida_painter."
_SECONDS = 60.0
_CANVAS = CanvasSize(0.12, 0.09)
_ROWS = 48
_COUNT = 6
_ABILITIES = (
    *(robot.Reach, robot.ZeroedRobot, robot.TimedRobot, robot.LimitedRobot),
    *(robot.ExaminedRobot, robot.GuidedRobot, robot.PausableRobot, robot.LooseRobot, robot.TouchProbe),
    robot.LiveCamera,
)
"""Optional protocols of a robot or a camera."""


@dataclass(frozen=True)
class PartFinding:
    """Outcome for one part.

    kind: group without "frida_painter.", for example "objectives"
    name: name of the part
    fault: sentence that says what is wrong; "" if it conforms
    """

    kind: str
    name: str
    fault: str = ""

    @property
    def passed(self) -> bool:
        """True if the part conforms."""
        return not self.fault

    def __str__(self) -> str:
        return f"{self.kind} {self.name}: {self.fault or 'conforms'}"


def check(
    package: str,
    *,
    kinds: Sequence[str] | None = None,
    examples: Mapping[str, str] | None = None,
    seconds: float = _SECONDS,
) -> list[PartFinding]:
    """Tries every part that a package registers, and returns a finding for each.

    package: name of the installed distribution, such as "own-parts" or "own_parts"
    kinds: groups to try, such as ["objectives"]. None: all
    examples: text for parts that need one, by name: {"mirror": "left-right", "trace": "trace:/tmp/sheet.csv"}
    seconds: time that a part may take before it counts as hanging
    Raises ConfigError if the package registers no part, or if a kind is unknown.

        >>> import frida_painter as fp
        >>> all(finding.passed for finding in fp.plugins.check("frida-painter", kinds=["mixers", "stroke_models"]))
        True
    """
    groups = {group.removeprefix(_PREFIX): group for group in _TRIALS}
    if kinds is not None and (unknown := sorted(set(kinds) - set(groups))):
        raise ConfigError(f"{unknown[0][:40]!r} is no kind of part; there are {', '.join(groups)}.")
    if not seconds > 0:
        raise ConfigError(f"{seconds} seconds were given to each part; give a number above 0.")
    found = [
        part
        for kind, group in groups.items()
        if kinds is None or kind in kinds
        for part in registry.parts(group).values()
        if any(_plain(one) == _plain(package) for one in part.packages)
    ]
    if not found:
        raise ConfigError(
            f"No installed package {package[:60]!r} registers a part of a kind that was asked for; install it, or see "
            "`frida-painter doctor`."
        )
    return [_try(part, MappingProxyType(dict(examples or {})), seconds) for part in found]


def _plain(package: str) -> str:
    return package.lower().replace("_", "-")


def _try(part: registry.Part, examples: Mapping[str, str], seconds: float) -> PartFinding:
    """Returns the finding for a part, within the time."""
    faults: list[str] = []

    def attempt() -> None:
        try:
            kind, trial, words = _TRIALS[part.group]
            loaded = part.load(kind)
            _require_words(loaded, *words)
            trial(loaded, _Given(part.name, examples))
        except FridaError as error:
            faults.append(str(error))
        except BaseException as failure:  # a foreign part may raise anything, also SystemExit
            why = " ".join(f"{type(failure).__name__}: {failure}".split())[:200]
            faults.append(f"It raised {why}; a part raises errors of frida_painter.errors, or works.")

    thread = threading.Thread(target=attempt, name=f"trial of {part.name}", daemon=True)
    thread.start()
    thread.join(seconds)
    if thread.is_alive():
        faults = [f"It did not answer within {seconds:g} seconds; a part does its work and returns."]
    return PartFinding(part.group.removeprefix(_PREFIX), part.name, *faults[:1])


@dataclass(frozen=True)
class _Given:
    """Name of the part that is tried, and the examples by name."""

    name: str
    examples: Mapping[str, str]

    def text(self, default: str | None = None) -> str:
        """Returns the example of this part. Raises ConfigError if there is none and no default."""
        if self.name in self.examples:
            return self.examples[self.name]
        if default is None:
            raise ConfigError(f"It needs a text to be tried with; give examples={{{self.name!r}: TEXT}}.")
        return default


def _require(holds: bool, sentence: str) -> None:
    if not holds:
        raise PluginError(sentence)


def _require_words(kind: Any, *names: str) -> None:
    """Requires texts that people read in lists; the form of a machine or a camera begins with its name."""
    for name in names:
        words = getattr(kind, name, "")
        _require(isinstance(words, str) and bool(words.strip()), f"Its {name} says nothing; people read it in lists.")
        if name == "form":
            _require(words.startswith(kind.name), f"Its form {words!r} does not begin with its name.")


def _picture(rows: int = _ROWS) -> Tensor:
    """Returns a picture [3, rows, columns] of a dark disc before a graded ground."""
    columns = round(rows * _CANVAS.width / _CANVAS.height)
    y, x = torch.meshgrid(torch.linspace(0, 1, rows), torch.linspace(0, 1, columns), indexing="ij")
    ground = torch.stack((0.9 - 0.2 * y, 0.8 - 0.1 * x, 0.6 + 0.3 * x))
    return torch.where(((x - 0.4) ** 2 + (y - 0.5) ** 2) < 0.05, 0.2 * ground, ground)


def _plan() -> Plan:
    """Returns a plan of two strokes in two paints."""
    palette = Palette(["#f0e0d0", "#203040"])
    rows = [[0.02, 0.05, 0.3, 0.02, 0.002, 0.5, 0, 0, 0], [0.06, 0.04, -0.4, 0.03, -0.002, 0.8, 0, 0, 0]]
    limits = StrokeLimits((0.008, 0.048), (-0.014, 0.014))
    return Plan.of(Strokes.from_array(rows), palette, torch.tensor([0, 1]), brush="fine", limits=limits, canvas=_CANVAS)


def _try_robot(kind: RobotKind, given: _Given) -> None:
    place = FlatbedWorkspace().motion(_CANVAS).workspace
    place = replace(place, home=(0.0, 0.0, place.upper[2]))
    if _sample(kind.form):
        went_on = "was accepted"
        try:
            kind.open(MachineName.of(kind.name, kind.form), place)
        except FridaError:
            went_on = ""
        except Exception as failure:  # what should have been refused went on
            went_on = f"raised {type(failure).__name__}"
        _require(not went_on, f"A name without its place {went_on}; refuse it with ConfigError and a sentence.")
    text = given.text(_sample(kind.form) or kind.name)
    named = text if text.partition(":")[0] == kind.name else f"{kind.name}:{text}"
    machine = MachineName.of(named, kind.form)
    _open_device(lambda: kind.open(machine, place), given, robot.Robot)
    identities = kind.identify(machine)
    _require(
        isinstance(identities, frozenset) and bool(identities),
        "Its identify returned no frozenset of identities; a stop is latched under each of them.",
    )


def _sample(form: str) -> str:
    """Returns the place in a form, such as "PORT" in "gcode:PORT[,baud=RATE]", to open a part with; "" without one."""
    return form.partition("[")[0].partition(":")[2]


def _open_device(make: Callable[[], Any], given: _Given, protocol: type) -> None:
    """Opens a driver, and requires its protocol and those of its abilities.

    Raises ConfigError, which asks for an example, if it was opened without one in vain.
    """
    try:
        made = make()
    except FridaError as refusal:
        if given.name in given.examples:
            raise
        raise ConfigError(
            f"It could not be looked at, as its form is no place ({refusal}); give examples={{{given.name!r}: TEXT}}."
        ) from refusal
    for wanted in (protocol, *(ability for ability in _ABILITIES if isinstance(made, ability))):
        registry.require_like(made, wanted, "Its driver")


def _try_camera(kind: CameraKind, given: _Given) -> None:
    _open_device(lambda: kind.open(given.text(_sample(kind.form))), given, robot.Camera)


def _try_easel(kind: EaselKind, given: _Given) -> None:
    for name, declared in (("open", lambda kind, order: None), ("load", lambda kind: None)):
        _require(registry.takes(getattr(kind, name), declared), f"Its {name} is no function of what the program gives.")
    _require(not (kind.person and kind.simulated), "It is simulated and painted by a person; it is one of them.")


def _try_brush(kind: BrushModel, given: _Given) -> None:
    model = kind.load()
    _require(model.brush == kind.name, f"Its stroke model is of the brush {model.brush!r}.")
    _require(model.limits == kind.kind.limits, "Its stroke model has other limits than its brush.")
    require_stroke_model(model, "Its stroke model", PluginError)
    (least, most), (left, right) = model.limits.length, model.limits.bend
    thickness = torch.tensor([0.0, 0.5, 1.0, 1.0])
    length, bend = torch.tensor([least, most, most, least]), torch.tensor([0.0, left, right, 0.0])
    maps, again = (model(thickness, length, bend).detach() for _ in range(2))
    _require(torch.equal(maps, again), "It gives other maps for the same strokes; take chance from a seed.")
    edge = torch.cat((maps[:, 0], maps[:, -1], maps[:, :, 0], maps[:, :, -1]), 1)
    _require(float(edge.max()) < 0.05, "Its marks touch the edge of its frame and would be cut; make the frame larger.")


def _try_family(kind: FamilyPart, given: _Given) -> None:
    family = kind.load()
    _require(family.name == kind.name, f"Its file holds the family {family.name!r}.")


def _try_goal(kind: GoalKind, given: _Given) -> None:
    is_ours = kind.name in registry.OUR_PARTS[registry.OBJECTIVES]
    with TemporaryDirectory() as folder:
        shown: Any = Path(folder) / "picture.png"
        if kind.gives is Gives.PICTURE:
            images.save(_picture(), shown)
        else:
            shown = given.text("a lemon" if kind.networks or is_ours else None)
        term: Any = kind.open(shown, 1.0)
    weight = getattr(term, "weight", None)
    _require(isinstance(weight, int | float) and weight == 1.0, "Its term does not keep the weight that it was given.")
    for wrong in (0.0, float("nan")):
        try:
            if kind.gives is Gives.WORDS:
                kind.open(given.text("a lemon"), wrong)
            else:
                type(term)(term.image, wrong)
        except (ConfigError, AttributeError, TypeError):
            continue  # it was refused, or is a picture term of another form
        raise PluginError(f"It accepts a weight of {wrong}; call require_weight.")
    if kind.networks or not term.is_tried:
        return  # its networks need not be here
    grid = PixelGrid.of_height(_CANVAS, _ROWS)
    made = term.fit_to(grid.rows, grid.columns).prepare(ObjectiveContext(grid, EncoderRegistry(), 0))
    require_objective(made.objective, "Its objective", grid.rows, grid.columns, torch.device("cpu"))
    if made.validation is not None:
        with torch.no_grad():
            value = made.validation(_picture())
        _require(isinstance(value, Tensor) and value.dim() == 0, "Its validation returns no number.")


def _try_policy(parse: Any, given: _Given) -> None:
    _require(callable(parse), "It is not a function of the text after the colon.")
    for text in (given.examples.get(given.name), "0.5", "10", "2", ""):
        if text is None:
            continue
        try:
            policy = parse(text)
        except ConfigError:
            continue
        registry.require_like(policy, ReplanPolicy, "Its policy")
        for done, of in ((0, 100), (37, 100), (99, 100)):
            look = policy.next_look(done, of)
            _require(
                isinstance(look, int) and done < look <= of,
                f"Its next_look({done}, {of}) returned {look!r}; it is a whole number above {done} and at most {of}.",
            )
        wants = policy.wants_replan(CanvasSeen(10, 90, 0.02))
        _require(isinstance(wants, bool), f"Its wants_replan returned a {type(wants).__name__}; it returns a bool.")
        return
    raise ConfigError(f"It refused every text that was tried; give examples={{{given.name!r}: TEXT}}.")


def _try_exporter(kind: ExporterKind, given: _Given) -> None:
    first = kind.export(_plan())
    _require(len(first) > 0, "It returned an empty file.")
    _require(kind.export(_plan()) == first, "It returned another file for the same plan.")
    kind.export(_plan().part([]))


def _try_planner(kind: PlannerKind, given: _Given) -> None:
    chosen = PlannerSettings.of(
        canvas=_CANVAS, brushes="fine", strokes=_COUNT, colors=2, render_height=64, effort=0.05, focus="none", layers=1,
        planner=given.name,
    )  # fmt: skip
    planner = Planner(Goal((ImageTerm(_picture()),)), chosen)
    task = PlanningTask(planner, planner.bare, _COUNT, 2, lambda step: None)
    made = kind.make(task)
    _require(kind.make(task).digest == made.digest, "It made another plan from the same seed.")
    rest = made.part(list(range(2, len(made))))
    kind.make_rest(PlanningTask(planner, planner.expected(made), len(rest), 2, lambda step: None), rest)


def _try_mixer(kind: MixerKind, given: _Given) -> None:
    paints = usual_paints()[:3]
    absorption = torch.stack([paint.absorption for paint in paints])
    scattering = torch.stack([paint.scattering for paint in paints])
    pure = kind.mix(torch.eye(3, dtype=absorption.dtype), absorption, scattering, Finish.matte)
    _require(tuple(pure.shape) == tuple(absorption.shape), f"It returned the shape {tuple(pure.shape)} for 3 paints.")
    _require(bool(((pure >= 0) & (pure <= 1)).all()), "It returned reflectances outside [0, 1].")
    doubled = kind.mix(2 * torch.eye(3, dtype=absorption.dtype), absorption, scattering, Finish.matte)
    _require(torch.allclose(pure, doubled, atol=1e-4), "Twice the paint gave another colour; only shares count.")


def _try_picture_maker(kind: PictureMakerKind, given: _Given) -> None:
    try:
        maker = kind.open(given.text(""))
    except ConfigError:
        if given.name in given.examples:
            raise
        return  # it needs a text, and says so
    registry.require_like(maker, PictureMaker, f"The {type(maker).__name__} that it opened")
    with TemporaryDirectory() as folder:
        request = PictureRequest("a lighthouse", (0, 1), 128, 128, Path(folder), torch.device("cpu"), _SECONDS)
        files = maker.make(request)
        _require(len(files) == 2, f"It made {len(files)} pictures for 2 seeds; it makes one for each.")
        for file in files:
            if isinstance(file, MakingFailed):
                raise file
            images.load(file)
    plain = all(isinstance(word, str) for fact in maker.facts.items() for word in fact)
    _require(plain, "Its facts are not words by name; records hold words.")


def _try_turn_policy(policy: TurnPolicy, given: _Given) -> None:
    before = torch.full_like(_picture(), 0.95)
    painted = torch.zeros(before.shape[1:], dtype=torch.bool)
    painted[10:14, 12:40] = True
    after = torch.where(painted, torch.tensor([0.1, 0.2, 0.5])[:, None, None], before)
    along = np.linspace(0, 1, 8)
    place = np.stack([0.03 + 0.06 * along, np.full(8, 0.065)], 1)
    mark = PersonStroke(1, "fine", 0, place, np.full(8, 0.5), np.zeros(8), np.zeros(8), 2.0)
    for count in (0, 2):  # with a goal, and without
        turn = TurnTaken(before, after, painted.numpy(), (mark,), ((0.1, 0.2, 0.5),), _plan(), 0, count, 4)
        try:
            answers = [policy.answer(turn) for _ in range(2)]
        except ConfigError as refusal:  # that turn has no answer of this kind
            _require(bool(str(refusal)), "It refuses a turn without a sentence.")
            continue
        answer, again = answers
        if not isinstance(answer, TurnAnswer):
            raise PluginError(f"It returned a {type(answer).__name__}; it returns a TurnAnswer.")
        _require(bool(answer.sentence.strip()), "Its answer has no sentence for the person.")
        if (forbidden := answer.forbidden) is not None:
            fits = forbidden.dtype == np.bool_ and forbidden.shape == tuple(painted.shape)
            _require(fits, f"It forbids a mask of {forbidden.shape}; for this canvas {tuple(painted.shape)}, of bool.")
        if answer.rest is not None:
            same = again.rest is not None and answer.rest.digest == again.rest.digest
            _require(same, "It gave another answer to the same turn; take every random choice from its seed.")


def _try_encoder(make: Any, given: _Given) -> None:
    _require(callable(make), "It is no function of a device.")
    encoder = make(torch.device("cpu"))
    registry.require_like(encoder, Encoder, "Its encoder")
    _require_words(encoder, "name")
    views = torch.stack([_picture(64), _picture(64).flip(2)]).requires_grad_()
    maps = encoder.features(views)
    shaped = len(maps) > 0 and all(each.dim() == 4 and len(each) == 2 for each in maps)
    _require(shaped, "Its features are no maps [n, c, h, w] of n views.")
    _require(all(bool(each.isfinite().all()) for each in maps), "Its features are not finite.")
    _require_gradient(sum(each.square().mean() for each in maps), views, "features")
    if callable(getattr(encoder, "embed_text", None)):
        registry.require_like(encoder, Reader, "Its encoder")
        words, seen = encoder.embed_text("a red apple"), encoder.embed_pictures(views)
        _require(words.dim() == 1 and tuple(seen.shape) == (2, len(words)), "Words and pictures have other lengths.")
        norms = torch.cat([words.norm()[None], seen.norm(dim=1)])
        _require(bool((norms - 1).abs().max() < 1e-3), "Its embeddings are not of unit length.")
        _require_gradient((seen @ words.detach()).sum(), views, "embed_pictures")
        _require(encoder.reads_all("a red apple") is True, "It says that it does not read three words.")


def _require_gradient(value: Any, views: Tensor, name: str) -> None:
    (slope,) = torch.autograd.grad(value, views) if value.requires_grad else (torch.zeros(1),)
    _require(bool(slope.isfinite().all() and slope.any()), f"Its {name} has no gradient to the pictures.")


def _try_library(make: Any, given: _Given) -> None:
    _require(callable(make), "It is no function that returns a library.")
    library = make()
    registry.require_like(library, PictureLibrary, "Its library")
    _require_words(library, "name")
    listed = library.captions()
    _require(bool(listed), "It lists no picture.")
    for file, captions in listed.items():
        named = bool(captions) and all(isinstance(one, str) and one.strip() for one in captions)
        _require(named, f"Its picture {file[:40]!r} has no caption.")
    picture = library.picture(next(iter(listed)))
    fits = picture.dim() == 3 and len(picture) == 4 and bool(((picture >= 0) & (picture <= 1)).all())
    _require(fits, f"It gave a picture of the shape {tuple(picture.shape)}; it gives [4, h, w] in [0, 1].")


def _try_studio_arm(kind: StudioArm, given: _Given) -> None:
    made = kind.furnish(_CANVAS, find_brush("fine"), 0)
    _require(isinstance(made, ArmAndTable), f"Its furnish returned a {type(made).__name__}; it returns an ArmAndTable.")
    registry.require_like(made.arm, Arm, "Its arm")


_TRIALS: Mapping[str, tuple[type[Any], Callable[[Any, _Given], None], tuple[str, ...]]] = {
    registry.ROBOTS: (RobotKind, _try_robot, ("form", "title")),
    registry.EASELS: (EaselKind, _try_easel, ("title",)),
    registry.CAMERAS: (CameraKind, _try_camera, ("form", "title")),
    registry.STROKE_MODELS: (BrushModel, _try_brush, ()),
    registry.STROKE_FAMILIES: (FamilyPart, _try_family, ()),
    registry.OBJECTIVES: (GoalKind, _try_goal, ("help", "label")),
    registry.REPLAN_POLICIES: (object, _try_policy, ()),
    registry.PLANNERS: (PlannerKind, _try_planner, ("help",)),
    registry.MIXERS: (MixerKind, _try_mixer, ("help",)),
    registry.PICTURE_MAKERS: (PictureMakerKind, _try_picture_maker, ("help",)),
    registry.EXPORTERS: (ExporterKind, _try_exporter, ("help",)),
    registry.TURN_POLICIES: (TurnPolicy, _try_turn_policy, ("title",)),
    registry.STUDIO_ARMS: (StudioArm, _try_studio_arm, ("easel",)),
    registry.ENCODERS: (object, _try_encoder, ()),
    registry.PICTURE_LIBRARIES: (object, _try_library, ()),
}
"""Class and trial of each kind of part, and its attributes that people read in lists, by its group."""
