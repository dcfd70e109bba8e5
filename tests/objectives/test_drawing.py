"""Drawings are recognised among pictures. Pillow draws them, so nothing here shares code with the recognition."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from PIL import Image, ImageDraw

from frida_painter.objectives.drawing import is_drawing, with_bold_lines
from frida_painter.objectives.image import ImageTerm
from frida_painter.objectives.objective import Goal
from frida_painter.system import images
from support.data import TARGETS

SIZE = 480, 360


def tensor(picture: Image.Image | np.ndarray) -> torch.Tensor:
    pixels = np.asarray(picture, dtype=np.float32) / 255 if isinstance(picture, Image.Image) else picture
    return torch.from_numpy(np.ascontiguousarray(pixels.clip(0, 1), dtype=np.float32)).permute(2, 0, 1)


def house(ink: str = "black", paper: str = "white", width: int = 3) -> Image.Image:
    made = Image.new("RGB", SIZE, paper)
    draw = ImageDraw.Draw(made)
    draw.rectangle((120, 160, 320, 320), outline=ink, width=width)
    draw.line(((110, 165), (220, 60), (330, 165)), fill=ink, width=width, joint="curve")
    draw.arc((190, 230, 250, 340), 180, 360, fill=ink, width=width)
    draw.ellipse((360, 40, 430, 110), outline=ink, width=width)
    draw.line(((20, 322), (460, 318)), fill=ink, width=width)
    return made


def pencil() -> np.ndarray:
    across, down = np.meshgrid(np.linspace(0, 1, SIZE[0]), np.linspace(0, 1, SIZE[1]))
    light = (0.8 - 0.15 * across - 0.1 * down**2)[..., None] * np.array((1, 0.98, 0.94))
    grain = np.random.default_rng(0).normal(0, 0.01, (SIZE[1], SIZE[0], 3))
    return light * (0.45 + 0.55 * np.asarray(house(width=2)) / 255) + grain


def chart() -> Image.Image:
    made = Image.new("RGB", SIZE, "white")
    draw = ImageDraw.Draw(made)
    draw.rectangle((60, 30, 450, 310), outline="black", width=2)
    for color, turns in (("#1f77b4", 2.0), ("#d62728", 3.0)):
        x = np.linspace(62, 448, 200)
        draw.line([*zip(x, 170 + 110 * np.sin(x / 386 * 2 * np.pi * turns), strict=True)], fill=color, width=3)
    for number in range(5):
        draw.text((60 + 90 * number, 318), f"{number / 4:.2f}", fill="black")
    return made


def line() -> Image.Image:
    made = Image.new("RGB", SIZE, "white")
    ImageDraw.Draw(made).line(((10, 340), (470, 20)), fill="black", width=2)
    return made


DRAWINGS: dict[str, Callable[[], Image.Image | np.ndarray]] = {
    "pen": house,
    "pencil on grey paper in uneven light": pencil,
    "chalk on a board": lambda: house("#e8e8e0", "#141814", 4),
    "chart in colours": chart,
    "one thin line": line,
}


def even(color: str, size: tuple[int, int] = SIZE) -> Image.Image:
    return Image.new("RGB", size, color)


def moon() -> Image.Image:
    made = even("#05060c")
    ImageDraw.Draw(made).ellipse((200, 120, 290, 210), fill="#e8e4d8")
    return made


def silhouette() -> np.ndarray:
    sky = np.linspace(0.95, 0.55, SIZE[1])[:, None, None] * np.ones((1, SIZE[0], 3)) * np.array((1, 0.75, 0.5))
    hill = Image.new("L", SIZE, 0)
    ImageDraw.Draw(hill).polygon(((0, 360), (0, 250), (120, 180), (300, 260), (480, 200), (480, 360)), fill=1)
    return np.where(np.asarray(hill)[..., None] > 0, 0.04, sky)


def cartoon() -> Image.Image:
    made = house()
    for place, color in (
        ((220, 200), "#d83020"),
        ((395, 75), "#ffd820"),
        ((30, 30), "#70b0f0"),
        ((30, 350), "#40a040"),
    ):
        ImageDraw.floodfill(made, place, tuple(int(color[at : at + 2], 16) for at in (1, 3, 5)))
    return made


def on_table() -> Image.Image:
    made = even("#6a4628")
    made.paste(house().resize((200, 150)), (140, 100))
    return made


def written_photograph() -> Image.Image:
    made = Image.open(TARGETS / "coffee.jpg").convert("RGB").resize(SIZE)
    ImageDraw.Draw(made).text((40, 40), "GOOD MORNING", fill="black", font_size=48)
    return made


OTHERS: dict[str, Callable[[], Image.Image | np.ndarray]] = {
    "black": lambda: even("black"),
    "white": lambda: even("white"),
    "one colour": lambda: even("#4080c0"),
    "two pixels": lambda: even("#202020", (2, 1)),
    "the moon": moon,
    "a silhouette before the sky": silhouette,
    "a cartoon with filled areas": cartoon,
    "a drawing on a table": on_table,
    "words on a photograph": written_photograph,
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_lines_on_an_even_ground_are_a_drawing(name: str) -> None:
    assert is_drawing(tensor(DRAWINGS[name]()))


@pytest.mark.parametrize("name", OTHERS)
def test_other_pictures_are_none(name: str) -> None:
    assert not is_drawing(tensor(OTHERS[name]()))


def test_photographs_are_none() -> None:
    photographs = sorted(TARGETS.glob("*.jpg"))
    assert len(photographs) > 8
    assert [path.name for path in photographs if is_drawing(images.load(path))] == []


def bold(picture: torch.Tensor, width: float) -> np.ndarray:
    (term,) = with_bold_lines(Goal((ImageTerm(picture),)), width).terms
    assert term.guide is not None
    return term.guide.permute(1, 2, 0).numpy()


def test_a_thin_line_becomes_as_wide_as_a_mark_in_full_ink_on_white() -> None:
    wide = bold(tensor(line()), 12 / 360)
    across = np.hypot(460, 320) / 320  # pixels of a row per pixel across the line
    in_rows = (wide.min(2) < 0.5).sum(1)[80:280].mean() * 320 / np.hypot(460, 320)
    assert across > 1 and 8 < in_rows < 16
    assert wide.min() < 0.05 and np.median(wide) == 1


def test_chalk_stays_light_on_a_dark_ground() -> None:
    wide = bold(tensor(DRAWINGS["chalk on a board"]()), 0.02)
    assert np.median(wide) == 0 and wide.max() > 0.95


def test_dense_lines_do_not_flow_together() -> None:
    made = even("white")
    draw = ImageDraw.Draw(made)
    for row in range(10, 360, 20):
        draw.line(((0, row), (480, row)), fill="black", width=2)
    dark = bold(tensor(made), 1 / 20)[:, 240].min(1) < 0.5
    assert np.diff(dark.astype(int)).clip(min=0).sum() == 18 and dark.mean() < 0.6
