"""Words become pictures before a painting: what is asked of a maker, what it may return, and what is kept of it."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import ConfigError, Interrupted, MakingFailed, PluginError, WeightsError
from frida_painter.planning.problem import Region
from frida_painter.runs.goal_item import making_facts, read_making
from frida_painter.runs.goals import open_goal
from frida_painter.runs.painting_folder import keep_goal, read_goal
from frida_painter.runs.settle import open_planner
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images, storage
from frida_painter_cli.imagining import usual_maker
from frida_painter_words.picture_makers import making as picture_making
from frida_painter_words.picture_makers.making import (
    Making,
    MakingWish,
    PictureMakerKind,
    PictureRequest,
    SeenCanvas,
    imagine,
    make_each,
    make_pictures,
    require_canvas_maker,
)

SPEC = RunSpec.of(goal=[{"text": "a lighthouse", "weight": 2.0}], canvas="12x9cm", seed=5)


@dataclass
class Maker:
    """A maker that writes what it is told to."""

    returns: Any = None
    facts: dict[str, str] = field(default_factory=lambda: {"model": "a fake", "sha256": "0f" * 32})
    asked: list[PictureRequest] = field(default_factory=list)

    def make(self, request: PictureRequest) -> Sequence[Path | MakingFailed]:
        self.asked.append(request)
        if isinstance(self.returns, BaseException):
            raise self.returns
        files = []
        for number, seed in enumerate(request.seeds):
            files.append(request.folder / f"{number}.png")
            made = self.returns(seed) if callable(self.returns) else scene(seed)
            files[-1].write_bytes(made) if isinstance(made, bytes) else images.save(made, files[-1])
        return files[: self.returns] if isinstance(self.returns, int) else files


def scene(seed: int) -> Tensor:
    return torch.rand(3, 30, 40, generator=torch.Generator().manual_seed(seed))


def make(monkeypatch: pytest.MonkeyPatch, folder: Path, maker: Maker, **more: Any) -> Making:
    monkeypatch.setattr(picture_making, "open_picture_maker", lambda text: ("fake", maker))
    wish = MakingWish("a lighthouse", "fake", **{name: more.pop(name) for name in ("count", "minutes") if name in more})
    return make_pictures(wish, folder, SPEC, **{"encoders": NoNetworks(), **more})


@dataclass
class Here:
    """The networks that are here."""

    sees_meaning: bool = False
    reads_by_clip: bool = False


class NoNetworks:
    def reader(self) -> Any:
        raise ConfigError("None is here.")


def test_a_making_asks_once_for_all_seeds_in_the_canvas_s_proportions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker = Maker()
    making = make(monkeypatch, tmp_path / "made", maker, count=3, minutes=2)
    (request,) = maker.asked
    assert (request.words, request.seeds, request.seconds) == ("a lighthouse", (5, 6, 7), 120)
    assert (request.width, request.height) == (576, 448) and request.device.type in ("cpu", "cuda")
    assert [one.file.name for one in making.pictures] == [f"a-lighthouse-{n}.png" for n in (1, 2, 3)]
    assert making.made_by == "fake, a fake" and making.best == 0 and "it is the first" in making.rule
    assert torch.equal(making.pictures[1].picture, images.load(making.pictures[1].file)), "no bit is lost"
    assert not [path for path in making.folder.iterdir() if path.name.startswith(".")]


def half_dark(rows: int = 60, columns: int = 80) -> Tensor:
    picture = torch.full((3, rows, columns), 0.9)
    picture[:, :, : columns // 2] = 0.1
    return picture


def test_pictures_begin_from_the_canvas_and_keep_what_is_protected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closed = torch.zeros(60, 80, dtype=torch.bool)
    closed[:20, 60:] = True
    canvas = SeenCanvas(half_dark(), SPEC.canvas, Region(closed))
    pictures = {5: 0.7 * half_dark(30, 40), 6: half_dark().flip(2), 7: scene(0).expand(3, 30, 40)[:, :, :30]}
    maker, told = Maker(lambda seed: pictures[seed]), list[str]()
    making = make(monkeypatch, tmp_path / "made", maker, count=3, canvas=canvas, tell=told.append)
    (request,) = maker.asked
    assert request.canvas is not None and request.free is not None
    assert (images.load(request.canvas) - canvas.picture).abs().max() < 0.01
    assert torch.equal(images.load(request.free)[0] < 0.5, closed)
    first, second = (one.picture for one in making.pictures)
    assert first.shape == canvas.picture.shape and (first - 0.7 * canvas.picture)[:, 20:].abs().mean() < 0.02
    for made in (first, second):
        assert torch.equal(made[:, closed], canvas.picture[:, closed])
    assert len(told) == 1 and "30 x 30 pixels, and the canvas 80 x 60" in told[0]
    making.choose(0, "a person chose it")
    assert read_making(making.pictures[0].file)[0]["canvas"] == storage.sha256(request.canvas, "")  # type: ignore[index]


def test_a_maker_that_takes_no_canvas_is_not_asked_for_a_painting() -> None:
    with pytest.raises(ConfigError, match="is not given the canvas"):
        require_canvas_maker("command:true {words}")
    require_canvas_maker("command:true {canvas}")
    require_canvas_maker("http://localhost/sdapi/v1/txt2img")
    with pytest.raises(ConfigError, match="no picture maker called 'crystal'"):
        require_canvas_maker("crystal:ball")


def test_the_nearest_to_the_words_is_best(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Reader:
        name, side = "a network that likes green", 8

        def embed_text(self, prompt: str) -> Tensor:
            return torch.tensor([0.0, 1.0, 0.0])

        def embed_pictures(self, pictures: Tensor) -> Tensor:
            return torch.nn.functional.normalize(pictures.mean((2, 3)), dim=1)

    class Networks:
        def reader(self) -> Any:
            return Reader()

    shades = {5: (0.5, 0.1, 0.1), 6: (0.1, 0.5, 0.1), 7: (0.1, 0.1, 0.5)}
    maker = Maker(lambda seed: 0.9 * torch.tensor(shades[seed])[:, None, None] + 0.1 * scene(seed))
    making = make(monkeypatch, tmp_path / "made", maker, count=3, encoders=Networks())
    assert making.best == 1 and making.rule == "it is the nearest to the words by a network that likes green"


@pytest.mark.parametrize(
    ("returns", "error", "says"),
    [
        (0, MakingFailed, "fake made no picture, and was asked for 2"),
        (1, MakingFailed, "fake made 1 picture, and was asked for 2"),
        (
            lambda seed: torch.zeros(3, 30, 40),
            MakingFailed,
            "Picture 1 of fake cannot be painted: it is black all over",
        ),
        (lambda seed: torch.full((3, 30, 40), 0.5), MakingFailed, "of one colour all over"),
        (lambda seed: b"<html>Sign in</html>", MakingFailed, "Picture 1 of fake cannot be painted"),
        (lambda seed: b"", MakingFailed, r"Picture 1 of fake cannot be painted: it is empty \(0 bytes\)"),
        (ValueError("no\nreason"), PluginError, r"'fake' failed \(ValueError: no reason\); mend it"),
        (Interrupted("You stopped."), Interrupted, "You stopped"),
    ],
)
def test_what_cannot_be_painted_is_one_sentence_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, returns: Any, error: type[Exception], says: str
) -> None:
    with pytest.raises(error, match=says) as told:
        make(monkeypatch, tmp_path / "made", Maker(returns), count=2)
    assert "\n" not in str(told.value) and not (tmp_path / "made").exists()


def test_a_bad_picture_among_good_ones_is_left_out_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    maker = Maker(lambda seed: scene(seed) if seed != 5 else torch.zeros(3, 30, 40))
    making = make(monkeypatch, tmp_path / "made", maker, count=3, tell=told.append)
    assert [one.seed for one in making.pictures] == [6, 7]
    assert told == list(making.faults) == ["Picture 1 is left out: it is black all over."]


def test_pictures_that_could_not_be_made_are_left_out_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Some(Maker):
        def make(self, request: PictureRequest) -> Sequence[Path | MakingFailed]:
            files = list(super().make(request))
            return make_each(request, "The fake", lambda number, *_: files[number] if number == 1 else fail(number))

    def fail(number: int) -> Path:
        raise MakingFailed(f"Seed {number} is unlucky; take another.")

    making = make(monkeypatch, tmp_path / "made", Some(), count=3)
    assert [one.seed for one in making.pictures] == [6]
    assert making.faults == tuple(f"Picture {n} is left out: Seed {n - 1} is unlucky; take another." for n in (1, 3))
    with pytest.raises(MakingFailed, match=r"^Seed 0 is unlucky; take another\.$"):
        make(monkeypatch, tmp_path / "other", Some(), count=1)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"count": 0}, "0 pictures were asked for; a making has 1 to 16"),
        ({"count": 17}, "17 pictures"),
        ({"minutes": float("nan")}, "nan minutes"),
        ({"minutes": 0.0}, "0 minutes"),
    ],
)
def test_numbers_that_make_no_sense(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, more: dict[str, Any], says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        make(monkeypatch, tmp_path / "made", Maker(), **more)


def test_makers_that_are_not_there() -> None:
    with pytest.raises(ConfigError, match="There is no picture maker called 'dall'; there are command"):
        picture_making.open_picture_maker("dall:e")
    with pytest.raises(ConfigError, match="'~nobody-at-all/net' is neither a folder that is here nor a name"):
        picture_making.open_picture_maker("diffusers:~nobody-at-all/net")


def test_a_maker_that_cannot_be_opened_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    class Part:
        def load(self, kind: type) -> PictureMakerKind:
            return PictureMakerKind("own", "A maker that is broken.", lambda text: 1 / 0)  # type: ignore[return-value]

    monkeypatch.setattr(registry, "parts", lambda group: {"own": Part()})
    with pytest.raises(PluginError, match=r"'own' failed \(ZeroDivisionError: division by zero\); mend it"):
        picture_making.open_picture_maker("own:x")


def test_a_chosen_picture_is_an_ordinary_goal_and_its_record_follows_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    making = make(monkeypatch, tmp_path / "made", Maker(), count=2)
    spec = imagine(SPEC, lambda words, number: making.choose(1, "a person chose it"), Here())
    (item,) = spec.goal
    assert (item.kind, item.weight, spec.title, spec.name) == ("image", 2.0, "A lighthouse", "a-lighthouse-2")
    (fact,) = making_facts(*spec.goal, *spec.initial)
    assert fact == ("Made", "a-lighthouse-2.png from “a lighthouse” by fake, a fake, seed 6")
    keep_goal(spec, tmp_path / "painting")
    kept = RunSpec.of(**read_goal(tmp_path / "painting"))
    assert making_facts(*kept.goal, *kept.initial) == making_facts(*spec.goal, *spec.initial), (
        "also in the painting's folder, so that resume tells it too"
    )
    record = json.loads((tmp_path / "painting" / "goal" / "1" / "making.json").read_text())
    assert record["because"] == "a person chose it" and record["facts"]["sha256"] == "0f" * 32
    assert [one["seed"] for one in record["pictures"]] == [5, 6]


def test_a_clip_that_cannot_be_loaded_is_told_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    maker = Maker()
    monkeypatch.setattr(picture_making, "open_picture_maker", lambda text: ("fake", maker))
    with pytest.raises(WeightsError, match="nowhere at all cannot be loaded as CLIP"):
        make_pictures(MakingWish("a lighthouse", "fake"), tmp_path / "made", SPEC.with_values(clip="nowhere at all"))
    assert not maker.asked and not list(tmp_path.iterdir()), "no folder stays either"


def test_a_clip_that_chose_among_made_pictures_was_of_use(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    making = make(monkeypatch, tmp_path / "made", Maker(), count=2)
    spec = imagine(SPEC, lambda words, number: making.choose(1, "it is the nearest"), Here()).with_values(
        clip="my/clip"
    )
    open_planner(spec, open_goal(spec))
    (making.folder / "making.json").unlink()
    with pytest.raises(ConfigError, match="nothing of this goal is seen through a CLIP"):
        open_planner(spec, open_goal(spec))


@pytest.mark.parametrize(
    ("here", "goal"),
    [
        (Here(), [("style", 1.0), ("image", 2.0)]),
        (Here(sees_meaning=True), [("style", 1.0), ("semantic", 2.0)]),
        (Here(sees_meaning=True, reads_by_clip=True), [("style", 1.0), ("semantic", 2.0), ("text", 1.0)]),
    ],
)
def test_a_made_picture_is_painted_by_its_content_and_the_words_are_a_second_term(
    tmp_path: Path, here: Here, goal: list[tuple[str, float]]
) -> None:
    images.save(scene(1), tmp_path / "made.png")
    wish = RunSpec.of(goal=[{"style": str(tmp_path / "made.png")}, {"text": "a lighthouse", "weight": 2.0}])
    spec = imagine(wish, lambda words, number: tmp_path / "made.png", here)
    assert [(item.kind, item.weight) for item in spec.goal] == goal
    wish = RunSpec.of(goal=[{"text": "\u5e06\u8239"}])
    assert len(imagine(wish, lambda words, number: tmp_path / "made.png", here).goal) == 1, "a CLIP cannot read it"


@pytest.mark.parametrize(
    ("wish", "made"),
    [
        ({"goal": [{"text": "a ship"}]}, True),
        ({"goal": [{"text": "a ship"}, {"style": "waves.png"}]}, True),
        ({"goal": [{"text": "a storm"}], "initial": [{"text": "a ship"}]}, True),
        ({"goal": [{"text": "a ship"}], "beginning": "scene"}, False),
        ({"goal": [{"text": "a ship"}], "beginning": "nothing"}, False),
        ({"goal": [{"text": "a ship"}], "pictures": "."}, False),
        ({"goal": [{"text": "a ship"}, {"image": "photo.png"}]}, False),
        ({"goal": [{"text": "a ship"}], "initial": [{"image": "photo.png"}]}, False),
        ({"goal": [{"style": "waves.png"}]}, False),
    ],
)
def test_the_fetched_maker_begins_words_that_come_without_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wish: dict[str, Any], *, made: bool
) -> None:
    monkeypatch.setenv("FRIDA_PAINTER_MODELS", str(tmp_path))
    assert usual_maker(RunSpec.of(**wish)) is None
    (tmp_path / "imagine").mkdir()
    (tmp_path / "imagine" / "record.json").write_text("{}")
    assert (usual_maker(RunSpec.of(**wish)) == "diffusers") == made


def test_words_of_the_start_are_made_and_those_of_the_goal_stay(tmp_path: Path) -> None:
    images.save(scene(1), tmp_path / "made.png")
    both = RunSpec.of(goal=[{"text": "a storm"}], initial=[{"text": "a ship"}])
    asked: list[tuple[str, int]] = []

    def made(words: str, number: int) -> Path:
        asked.append((words, number))
        return tmp_path / "made.png"

    spec = imagine(both, made, Here(sees_meaning=True, reads_by_clip=True))
    assert [item.kind for item in (*spec.goal, *spec.initial)] == ["text", "image"] and asked == [("a ship", 1)]
    with pytest.raises(ConfigError, match="--imagine makes a picture from words, and there are none"):
        imagine(RunSpec.of(goal=[{"image": str(tmp_path / "made.png")}]), made, Here())


@pytest.mark.parametrize("spoilt", ["{", "[]", '{"format": "frida-painter making"}', ""])
def test_a_record_that_belongs_to_no_picture_is_no_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoilt: str
) -> None:
    making = make(monkeypatch, tmp_path / "made", Maker(), count=1)
    chosen = making.choose(0, making.rule)
    assert read_making(chosen) is not None
    images.save(scene(9), chosen)
    assert read_making(chosen) is None, "another picture of the same name"
    (tmp_path / "made" / "making.json").write_text(spoilt)
    assert read_making(chosen) is None
