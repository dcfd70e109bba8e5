"""Conformance of parts: ours pass, the example's pass, and each way to be wrong is one sentence."""

import re
import time
from pathlib import Path

import pytest

import frida_painter as fp
from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter_cli import commands
from plugins import install, install_own_parts

EXAMPLES = {"mirror": "left-right", "trace": "sheet.csv"}
GOAL = """
from dataclasses import dataclass
from frida_painter.plugins import Gives, GoalKind, ObjectiveTerm, Term, require_weight

@dataclass(frozen=True)
class Calm(Term):
    words_given: str
    weight: float = 1.0
    def __post_init__(self):
        require_weight(self.weight, "calm")
    def prepare(self, context):
        return ObjectiveTerm(lambda picture: {loss})

KIND = GoalKind("calm", Gives.WORDS, "Calm.", "Calm", Calm)
"""
MAKER = """
from PIL import Image
from frida_painter.plugins import PictureMakerKind
class Calm:
    facts = {{"model": "a fake"}}
    def make(self, request):
        files = [request.folder / f"{{seed}}.png" for seed in request.seeds[:{count}]]
        for file in files:
            Image.effect_noise((64, 48), 80).convert("RGB").save(file)
        return files
KIND = PictureMakerKind("calm", "Makes pictures.", lambda text: Calm())
"""
EXPORTER = """
from frida_painter.plugins import ExporterKind
KIND = ExporterKind("calm", {help!r}, lambda plan, options: {made})
"""
POLICY = """
class Policy:
    def next_look(self, done, of):
        return {look}
    def wants_replan(self, seen):
        return {wants}
KIND = lambda text: Policy()
"""
MIXER = """
from frida_painter.plugins import MixerKind
KIND = MixerKind("calm", "Mixes.", lambda parts, absorption, scattering, finish: {mixed})
"""
TURN = """
import numpy as np
from frida_painter.plugins import TurnAnswer, TurnPolicy
KIND = TurnPolicy("calm", "Answer calmly", lambda turn: {answer})
"""
ENCODER = """
import torch
class Net:
    name = "calm"
    side = 64
    def features(self, views):
        return ({maps},)
    def reads_all(self, prompt):
        return True
    def embed_text(self, prompt):
        return torch.tensor([1.0, 0.0, 0.0])
    def embed_pictures(self, pictures):
        return {seen}
KIND = lambda device: Net()
"""
LIBRARY = """
import torch
class Pictures:
    name, credit, is_own = "calm", "", False
    def captions(self):
        return {{"a.png": {captions}}}
    def picture(self, file):
        return {picture}
KIND = Pictures
"""
ARM = """
from frida_painter.plugins import StudioArm
KIND = StudioArm("calm", "calm arm", lambda canvas, brush, seed: {made})
"""
ROBOT = """
from frida_painter.plugins import RobotKind
class Driver:
    def connect(self): pass
    def home(self): pass
    def pose(self): pass
    def follow({follow}): pass
    def stop(self): pass
{more}
KIND = RobotKind("calm", "calm{place}", "Calm", {opened}, identify=lambda name: frozenset({{"calm"}}))
"""
CAMERA = """
from frida_painter.plugins import CameraKind
class Driver:
    def connect(self): pass
    def capture({capture}): pass
    def close(self): pass
KIND = CameraKind("calm", "calm:PLACE", "Calm", open=lambda text: Driver())
"""
BRUSH = """
import torch
from frida_painter.plugins import BrushKind, BrushModel, StrokeLimits, MapFrame
LIMITS = StrokeLimits((0.01, 0.04), (-0.01, 0.01))
class Model:
    brush, limits, frame = "calm", LIMITS, MapFrame(-0.01, 0.05, -0.02, 0.02, 8, 12)
    def __call__({taken}):
        return {maps}
KIND = BrushModel(BrushKind("calm", LIMITS, 0.01), Model)
"""
STROKE = "self, thickness, length, bend"
MADE = "torch.nn.functional.pad(torch.ones(len(thickness), 4, 8), (2, 2, 2, 2))"
CLOSES = "    def close(self): pass"
OPENED = "lambda name, workspace: (name.require(), Driver())[1]"
NORMED = "torch.nn.functional.normalize(pictures.mean((2, 3)), dim=1)"


def finding_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str, module: str, seconds: float = 60.0
) -> fp.plugins.PartFinding:
    name = f"calm_{abs(hash((group, module)))}"
    install(tmp_path, monkeypatch, "calm", {group: {"calm": f"{name}:KIND"}}, {name: module})
    (found,) = fp.plugins.check("calm", examples={"calm": "softly"}, seconds=seconds)
    return found


@pytest.mark.parametrize(
    ("group", "module", "says"),
    [
        (registry.OBJECTIVES, GOAL.format(loss="picture.diff(dim=1).abs().mean()"), ""),
        (registry.OBJECTIVES, GOAL.format(loss="picture.detach().mean()"), "without a gradient"),
        (registry.OBJECTIVES, GOAL.format(loss="3.0"), "of type float"),
        (registry.OBJECTIVES, GOAL.format(loss="picture.mean()").replace("require_weight(self.w", "abs(self.w")
         .replace(', "calm")', ")"), "accepts a weight of 0.0; call require_weight"),
        (registry.OBJECTIVES, GOAL.format(loss="0").replace('"Calm.", "Calm"', '"", "Calm"'), "Its help says nothing"),
        (registry.OBJECTIVES, "KIND = 3\n", "is a int and should be a GoalKind"),
        (registry.OBJECTIVES, "1/0\n", "cannot be loaded .ZeroDivisionError"),
        (registry.OBJECTIVES, "raise SystemExit(3)\n", "cannot be loaded .SystemExit"),
        (registry.PICTURE_MAKERS, MAKER.format(count=2), ""),
        (registry.PICTURE_MAKERS, MAKER.format(count=1), "It made 1 pictures for 2 seeds"),
        (registry.PICTURE_MAKERS, MAKER.format(count=2).replace("Calm()", "3"), "has no facts"),
        (registry.PICTURE_MAKERS, MAKER.format(count=2).replace('"a fake"', "3"), "Its facts are not words by name"),
        (registry.EXPORTERS, EXPORTER.format(help="A.", made="str(len(plan))"), ""),
        (registry.EXPORTERS, EXPORTER.format(help="A.", made="len(plan)"), "returned a int; it returns text or bytes"),
        (registry.EXPORTERS, EXPORTER.format(help="A.", made="''"), "empty file"),
        (registry.EXPORTERS, EXPORTER.format(help="A.", made="str(__import__('time').monotonic_ns())"),
         "another file for the same plan"),
        (registry.REPLAN_POLICIES, POLICY.format(look="of", wants="True"), ""),
        (registry.REPLAN_POLICIES, POLICY.format(look="done", wants="True"), r"next_look\(0, 100\) returned 0"),
        (registry.REPLAN_POLICIES, POLICY.format(look="of", wants="1"), "wants_replan returned a int"),
        (registry.MIXERS, MIXER.format(mixed="parts @ absorption * 0 + 0.5"), ""),
        (registry.MIXERS, MIXER.format(mixed="parts @ absorption * 0 + 1.5"), r"outside \[0, 1\]"),
        (registry.MIXERS, MIXER.format(mixed="parts"), "It returned the shape"),
        (registry.TURN_POLICIES, TURN.format(answer="TurnAnswer('I go on.', turn.painted)"), ""),
        (registry.TURN_POLICIES, TURN.format(answer="'I go on.'"), "returned a str; it returns a TurnAnswer"),
        (registry.TURN_POLICIES, TURN.format(answer="TurnAnswer('')"), "no sentence for the person"),
        (registry.TURN_POLICIES, TURN.format(answer="TurnAnswer('I go on.', np.zeros((3, 3), bool))"),
         "forbids a mask of"),
        (registry.ENCODERS, ENCODER.format(maps="views * 2", seen=NORMED), ""),
        (registry.ENCODERS, ENCODER.format(maps="views.detach()", seen=NORMED), "features has no gradient"),
        (registry.ENCODERS, ENCODER.format(maps="views[0]", seen=NORMED), r"no maps \[n, c, h, w\]"),
        (registry.ENCODERS, ENCODER.format(maps="views", seen="pictures.mean((2, 3))"), "not of unit length"),
        (registry.PICTURE_LIBRARIES, LIBRARY.format(captions="('cup',)", picture="torch.zeros(4, 9, 9)"), ""),
        (registry.PICTURE_LIBRARIES, LIBRARY.format(captions="()", picture="torch.zeros(4, 9, 9)"), "has no caption"),
        (registry.PICTURE_LIBRARIES, LIBRARY.format(captions="('cup',)", picture="torch.zeros(3, 9, 9)"),
         r"it gives \[4, h, w\]"),
        (registry.ROBOTS, ROBOT.format(follow="self, way", more=CLOSES, place="", opened=OPENED), ""),
        (registry.ROBOTS, ROBOT.format(follow="self, way", more="", place="", opened=OPENED), r"has no close\(\)"),
        (registry.ROBOTS, ROBOT.format(follow="self", more=CLOSES, place="", opened=OPENED),
         r"called as follow\(waypoints\)"),
        (registry.ROBOTS, ROBOT.format(follow="self, way", more="    close = 3", place="", opened=OPENED),
         r"called as close\(\)"),
        (registry.ROBOTS, ROBOT.format(follow="self, way", place="", opened=OPENED,
         more=f"{CLOSES}\n    def travel_limits(self, axis): pass"), r"called as travel_limits\(\)"),
        (registry.CAMERAS, CAMERA.format(capture="self, newer_than"), ""),
        (registry.CAMERAS, CAMERA.format(capture="self"), r"called as capture\(newer_than\)"),
        (registry.STROKE_MODELS, BRUSH.format(taken=STROKE, maps=MADE), ""),
        (registry.STROKE_MODELS, BRUSH.format(taken="self, thickness", maps=MADE), "called as __call__"),
        (registry.STROKE_MODELS, BRUSH.format(taken=STROKE, maps=f"0 * {MADE}"), "marks nothing"),
        (registry.STROKE_MODELS, BRUSH.format(taken=STROKE, maps=f"2 * {MADE}"), r"not in \[0, 1\]"),
        (registry.STROKE_MODELS, BRUSH.format(taken=STROKE, maps="torch.full((len(thickness), 3, 3), 2.0)"),
         r"of shape \(4, 3, 3\)"),
        (registry.ENCODERS, ENCODER.format(maps="views * 2", seen=NORMED).replace("side = 64", ""), "has no side"),
        (registry.STUDIO_ARMS, ARM.format(made="None"), "furnish returned a NoneType"),
    ],
)  # fmt: skip
def test_each_way_to_be_wrong_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str, module: str, says: str
) -> None:
    found = finding_of(tmp_path, monkeypatch, group, module)
    if not says:
        assert found.passed, str(found)
        return
    assert re.search(says, found.fault), str(found)
    assert not found.passed and "\n" not in found.fault and found.fault.endswith(".")


@pytest.mark.parametrize("text", [None, "PORT"])
def test_a_driver_that_was_never_opened_does_not_conform(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str | None
) -> None:
    """A robot that needs a place was let through, with nothing of its driver looked at."""
    refuses = "lambda name, workspace: (_ for _ in ()).throw(__import__('frida_painter').FridaError('no such port'))"
    module, name = ROBOT.format(follow="self", more="", place=":PORT", opened=refuses), f"closed_{text}"
    install(tmp_path, monkeypatch, "calm", {registry.ROBOTS: {"calm": f"{name}:KIND"}}, {name: module})
    (found,) = fp.plugins.check("calm", examples={} if text is None else {"calm": text})
    assert not found.passed and ("examples=" in found.fault) == (text is None)


def test_a_part_that_hangs_is_a_finding(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    began = time.monotonic()
    found = finding_of(tmp_path, monkeypatch, registry.MIXERS, "import time\ntime.sleep(5)\nKIND = 3\n", 0.2)
    assert found.fault.startswith("It did not answer within 0.2 seconds") and time.monotonic() - began < 4


def test_what_cannot_be_tried_is_refused() -> None:
    with pytest.raises(ConfigError, match="No installed package 'nothing-here' registers a part"):
        fp.plugins.check("nothing-here")
    with pytest.raises(ConfigError, match="'brushes' is no kind of part; there are robots"):
        fp.plugins.check("frida-painter", kinds=["brushes"])
    with pytest.raises(ConfigError, match="give a number above 0"):
        fp.plugins.check("frida-painter", seconds=float("nan"))


def test_all_of_ours_conform() -> None:
    found = fp.plugins.check("frida-painter")
    assert [str(one) for one in found if not one.passed] == []
    assert {one.kind for one in found} == {
        "robots", "easels", "cameras", "stroke_models", "stroke_families", "objectives", "replan_policies", "planners",
        "mixers", "picture_makers", "exporters", "turn_policies", "studio_arms",
    }  # fmt: skip


def test_the_example_s_parts_conform(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    install_own_parts(tmp_path, monkeypatch)
    monkeypatch.chdir(tmp_path)
    examples = [part for name, text in EXAMPLES.items() for part in ("--example", f"{name}={text}")]
    monkeypatch.setattr("sys.argv", ["frida-painter", "parts", "own_parts", *examples])
    with pytest.raises(SystemExit) as left:
        commands.main()
    said = capsys.readouterr().out.splitlines()
    assert not left.value.code, said
    assert len(said) >= 9 and all(line.endswith(": conforms") for line in said)


def test_every_type_is_there_and_none_loads_pytorch() -> None:
    assert fp.plugins.__all__ == sorted(fp.plugins.__all__)
    for name in fp.plugins.__all__:
        assert getattr(fp.plugins, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'GoalKnd'; it offers"):
        fp.plugins.GoalKnd  # type: ignore[attr-defined]  # noqa: B018
