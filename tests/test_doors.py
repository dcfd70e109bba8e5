"""Whatever takes a canvas, a brush, a picture or a colour takes it in every form, and refuses what is none of them."""

import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

import frida_painter as fp
from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.weights import AnyBrush, load_stroke_model
from frida_painter.canvas_size import AnyCanvas, CanvasSize
from frida_painter.errors import ConfigError, ImageError, WeightsError
from frida_painter.strokes.palette import AnyColor, as_color
from frida_painter.system import images
from frida_painter.system.images import AnyPicture
from support.planning import picture

# Protocols say what a part of a person's own gets, which is always the plain form; a limit has no colour.
PROTOCOLS = {"Camera", "Robot", "StrokeModel", "Objective"}
# Read from a file or from the camera inside the program, where the form is known.
OF_PICTURES = ("picture", "photo", "photograph", "canvas", "before", "seen")
OF_COLORS = ("ground", "color", "darkest", "paint")


def public_callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Every public function, and each public method and constructor of every public class."""
    for name in fp.__all__:
        found = getattr(fp, name)
        if name in PROTOCOLS or inspect.ismodule(found):
            continue
        if not inspect.isclass(found):
            yield name, found
            continue
        for inner, member in inspect.getmembers(found):
            if inner == "__init__" and hasattr(found, "of"):
                continue  # it holds the plain forms; `of` takes them all
            if inner == "__init__" or (not inner.startswith("_") and (inspect.isroutine(member))):
                owner = next((each for each in found.__mro__ if inner in vars(each)), object)
                if owner.__module__.startswith("frida_painter"):
                    yield f"{name}.{inner}", member


def hints_of(called: Callable[..., Any]) -> dict[str, Any]:
    module = inspect.getmodule(called)
    names = dict(vars(module)) if module is not None else {}
    more = {"AnyBrush": AnyBrush, "AnyCanvas": AnyCanvas, "AnyPicture": AnyPicture, "AnyColor": AnyColor}
    try:
        return get_type_hints(called, {**more, **names})
    except NameError:  # a name that is imported for type checkers only, and that is none of these four
        return {}


def parts_of(annotation: Any) -> set[Any]:
    if isinstance(annotation, list):  # the arguments of a function
        return set().union(*map(parts_of, annotation))
    inner = get_args(annotation)
    return {annotation}.union(*map(parts_of, inner)) if inner else {annotation}


def faults() -> Iterator[str]:
    for name, called in public_callables():
        for parameter, annotation in hints_of(called).items():
            if parameter == "return":
                continue
            parts = parts_of(annotation)
            if CanvasSize in parts and str not in parts:
                yield f"{name}({parameter}) takes a CanvasSize alone"
            if StrokeModel in parts and not {str, Path} <= parts:
                yield f"{name}({parameter}) takes a stroke model alone"
            if Path in parts and str not in parts:
                yield f"{name}({parameter}) takes a Path alone"
            if Tensor in parts and parameter in OF_PICTURES and np.ndarray not in map(origin, parts):
                yield f"{name}({parameter}) takes a picture as a tensor alone"
            if tuple[float, float, float] in parts and parameter in OF_COLORS and str not in parts:
                yield f"{name}({parameter}) takes a colour as numbers alone"


def origin(annotation: Any) -> Any:
    return getattr(annotation, "__origin__", annotation)


def test_no_public_function_takes_one_form_alone() -> None:
    assert sorted(faults()) == []


def test_the_walk_sees_what_there_is() -> None:
    seen = dict(public_callables())
    assert {"render_batch", "Plan.save", "Plan.edit", "Planner.plan", "Strokes.project", "RunSpec.of"} <= set(seen)
    assert "canvas" in hints_of(seen["render_batch"]) and "canvas" in hints_of(seen["Planner.plan"])


@pytest.fixture(scope="module")
def strokes() -> fp.Strokes:
    return fp.Strokes.from_array([[0.03, 0.05, 0.2, 0.04, 0.0, 0.5, 0.8, 0.1, 0.1]])


def test_a_canvas_has_many_forms(strokes: fp.Strokes) -> None:
    same = [fp.render_batch("fine", strokes, canvas, rows=45).picture for canvas in ("12x9cm", CanvasSize(0.12, 0.09))]
    assert torch.equal(*same)
    for wrong in ((0.12, 0.09), None, 3):
        with pytest.raises(ConfigError, match=r"A canvas was given as .*; give its size as a text"):
            fp.render_batch("fine", strokes, wrong)  # type: ignore[arg-type]


def test_a_brush_has_many_forms(strokes: fp.Strokes) -> None:
    model = load_stroke_model("fine")
    file = Path(inspect.getfile(load_stroke_model)).with_name("fine.safetensors")
    bare = torch.ones(3, 45, 60)
    fast, *tables = (fp.render_strokes(strokes, brush, bare, "12x9cm") for brush in ("fine", file, str(file)))
    assert all(torch.equal(fast, table) for table in tables)
    exact = fp.render_strokes(strokes, "fine", bare, "12x9cm", exact=True)
    assert torch.equal(exact, fp.render_strokes(strokes, model, bare, "12x9cm"))
    assert 0 < float((fast - exact).abs().mean()) < 0.01
    with pytest.raises(WeightsError, match=r"A int .* has no brush"):
        fp.render_strokes(strokes, 3, torch.ones(3, 45, 60), "12x9cm")  # type: ignore[arg-type]


def test_a_picture_has_many_forms(tmp_path: Path) -> None:
    given = images.from_uint8(images.to_uint8(picture()))
    pixels = images.to_uint8(given)
    fp.save_picture(given, tmp_path / "a.png")
    forms = [str(tmp_path / "a.png"), tmp_path / "a.png", given, given.numpy(), pixels, Image.fromarray(pixels)]
    assert all(torch.equal(images.as_picture(form), given) for form in forms)
    goals = [fp.make_goal(form) for form in forms]
    assert all(torch.equal(goal.terms[0].image, given) for goal in goals)  # type: ignore[attr-defined]


def test_a_transparent_picture_lies_on_white() -> None:
    clear = Image.new("RGBA", (4, 3), (10, 20, 30, 0))
    assert bool((images.as_picture(clear) == 1).all())


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (torch.rand(8, 9, 3), r"\[3, height, width\]; turn it: picture.permute\(2, 0, 1\)"),
        (torch.rand(8, 9), r"shape \(8, 9\)"),
        (torch.full((3, 8, 9), 255, dtype=torch.uint8), "floating point in"),
        (torch.full((3, 8, 9), 200.0), "values from 200 to 200"),
        (torch.full((3, 8, 9), float("nan")), "values from nan"),
        (torch.rand(3, 0, 9), "not empty"),
        (np.zeros((8, 9, 4), np.uint8), r"shape \(8, 9, 4\)"),
        (7, "A picture was given as int"),
    ],
)
def test_what_is_no_picture_is_refused_with_a_sentence(wrong: Any, says: str) -> None:
    with pytest.raises(ImageError, match=says):
        fp.make_goal([wrong])


def test_a_color_has_many_forms() -> None:
    forms = ["#336699", " #336699", (0x33 / 255, 0x66 / 255, 0x99 / 255), torch.tensor([0.2, 0.4, 0.6])]
    assert all(as_color(form) == pytest.approx((0.2, 0.4, 0.6)) for form in forms)
    assert as_color("white") == (1.0, 1.0, 1.0)
    assert len(fp.Palette(["#ffffff", (0, 0, 0)])) == 2
    for wrong in ("blue", (0, 0), (0, 0, 2), (0, float("nan"), 0), None, [["a"]]):
        with pytest.raises(ConfigError, match="colour"):
            as_color(wrong)  # type: ignore[arg-type]
    grounds = [fp.RunSpec.of(ground=ground).ground for ground in ("#336699", (0.2, 0.4, 0.6))]
    assert grounds == ["#336699", "#336699"]


def test_strokes_of_another_precision_are_rendered_in_that_of_the_brush(strokes: fp.Strokes) -> None:
    plain = fp.render_strokes(strokes, "fine", torch.ones(3, 45, 60), "12x9cm")
    double = fp.render_strokes(strokes.to(torch.float64), "fine", torch.ones(3, 45, 60).double(), "12x9cm")
    assert double.dtype == torch.float32 and torch.allclose(plain, double, atol=1e-5)
