"""The page of a training or an evaluation: unseen strokes beside the model's prediction, in one HTML file."""

import base64
import io
from dataclasses import dataclass

import numpy as np
import torch
from markupsafe import Markup
from numpy.typing import NDArray
from PIL import Image
from torch import Tensor

from frida_painter import images
from frida_painter.brush.kinds import StrokeModel
from frida_painter.brush.library import StrokeLibrary
from frida_painter.report.chart import Series, chart
from frida_painter.report.page import template
from frida_painter_calibration.teaching.evaluation import Learned

_MAX_SHOWN = 24
_BATCH = 32
_TRAINING_PAGE_WIDTH = 300
_BINS = 12
_INK = torch.tensor([35.0, 33.0, 30.0]) / 255
_MISSED = torch.tensor([0.0, 114.0, 178.0]) / 255
_INVENTED = torch.tensor([230.0, 120.0, 20.0]) / 255
_TALL, _BAR, _SPACE = 190, 46, 8


@dataclass(frozen=True)
class _Stroke:
    """Stroke on the page: real, modelled, and the difference, as data URIs."""

    real: str
    drawn: str
    difference: str
    shape: str
    error: float


def training_page(learned: Learned, model: str, library: str, *, dirty: int) -> str:
    """Returns the page of a training as HTML without further files.

    model, library: names of both
    dirty: number of defective strokes that were left out of the training
    """
    report, held_out = learned.report, learned.library[learned.report.held_out]
    facts = [
        ("Stroke model", model),
        ("Brush", learned.model.brush),
        ("Strokes to learn from", str(len(learned.library) - len(held_out))),
        ("Strokes held out", str(len(held_out))),
        ("Dirty strokes left out", str(dirty)),
        ("Best epoch", f"{report.best_epoch} of {len(report.curve)}"),
    ]
    return _page(learned.model, held_out, report.predicted, library, facts, report.validation_error, _curve(learned))


def evaluation_page(model: StrokeModel, name: str, strokes: StrokeLibrary, library: str) -> str:
    """Returns the page of an evaluation: any stroke model beside strokes that it has not seen.

    name: of the model
    library: name of the strokes' library
    """
    shapes = strokes.shapes()
    with torch.no_grad():
        parts = torch.split(torch.arange(len(strokes)), _BATCH)
        drawn = torch.cat([model(*(values[part] for values in shapes)) for part in parts])
    facts = [("Stroke model", name), ("Brush", model.brush), ("Strokes", str(len(strokes)))]
    error = float((drawn - strokes.maps(model.frame)).abs().mean())
    return _page(model, strokes, drawn, library, facts, error, None)


def _page(
    model: StrokeModel, strokes: StrokeLibrary, drawn: Tensor, library: str, facts: list[tuple[str, str]],
    mean_error: float, curve: Tensor | None,
) -> str:  # fmt: skip
    """Returns the HTML of a page.

    drawn: [n, rows, columns], the model's predictions of the strokes
    curve: picture of the learning curve; None without training
    """
    wanted = strokes.maps(model.frame)
    error = (drawn - wanted).abs().mean((1, 2)).double().numpy()
    (shortest, longest), (least, most) = model.limits.length, model.limits.bend
    return template("training.html").render(
        library=library,
        error=mean_error,
        bare=float(wanted.mean()),
        count=len(error),
        strokes=_strokes(strokes, wanted, drawn, error),
        histogram=Markup(_histogram(error)),
        curve=None if curve is None else _data_uri(curve),
        facts=[
            *facts,
            ("Lengths", f"{1000 * shortest:.1f} to {1000 * longest:.1f} mm"),
            ("Bends", f"{1000 * least:.1f} to {1000 * most:.1f} mm"),
        ],
    )


def _strokes(library: StrokeLibrary, wanted: Tensor, drawn: Tensor, error: NDArray[np.float64]) -> list[_Stroke]:
    """Returns the strokes from the best to the worst, an even selection if there are too many."""
    order = error.argsort(kind="stable")
    if len(order) > _MAX_SHOWN:
        order = order[np.linspace(0, len(order) - 1, _MAX_SHOWN).round().astype(int)]
    rows, columns = _crop(wanted, drawn)
    shown = []
    for place in order:
        real, modelled = wanted[place, rows, columns], drawn[place, rows, columns]
        shown.append(
            _Stroke(
                _data_uri(_draw_ink(real)),
                _data_uri(_draw_ink(modelled)),
                _data_uri(_draw_comparison(real, modelled)),
                f"thickness {library.thickness[place]:.2f}, length {1000 * library.length_m[place]:.0f} mm, "
                f"bend {1000 * library.bend_m[place]:.0f} mm",
                float(error[place]),
            )
        )
    return shown


def _crop(wanted: Tensor, drawn: Tensor) -> tuple[slice, slice]:
    """Returns the part of the maps with paint, and a small margin."""
    inked = (torch.maximum(wanted, drawn) > 0.3).any(0)
    slices = []
    for axis in (1, 0):
        found = inked.any(axis).nonzero()[:, 0]
        first, last = (int(found[0]), int(found[-1])) if len(found) else (0, inked.shape[1 - axis] - 1)
        slices.append(slice(max(0, first - 2), last + 3))
    return slices[0], slices[1]


def _draw_ink(magnitude: Tensor) -> Tensor:
    """Returns a mark as ink on white paper, [3, rows, columns]."""
    return 1 - magnitude * (1 - _INK[:, None, None])


def _draw_comparison(real: Tensor, drawn: Tensor) -> Tensor:
    """Returns a picture of the differences between a real and a modelled mark, [3, rows, columns].

    Grey stands for paint in both, blue for paint of the brush only, orange for paint of the model only.
    """
    both = torch.minimum(real, drawn)
    layers = ((0.45 * both, _INK), (real - both, _MISSED), (drawn - both, _INVENTED))
    return 1 - sum((amount * (1 - color[:, None, None]) for amount, color in layers), torch.zeros(3, 1, 1))


def _curve(learned: Learned) -> Tensor:
    curve = learned.report.curve
    epochs = [float(step.epoch) for step in curve]
    return chart(
        "Error over epochs",
        "epoch",
        "mean absolute error of the magnitude (logarithmic)",
        [
            Series("held out", epochs, [max(1e-6, step.validation_error) for step in curve]),
            Series("learned from", epochs, [max(1e-6, step.training_error) for step in curve]),
        ],
        logarithmic=True,
    )


def _histogram(error: NDArray[np.float64]) -> str:
    """Returns a histogram of the held-out strokes' errors as inline SVG."""
    counts, edges = np.histogram(error, bins=_BINS, range=(0.0, float(error.max()) * 1.0001 + 1e-9))
    wide = _BINS * _BAR
    parts = [
        f'<svg class="bars" viewBox="0 0 {wide} {_TALL + 54}" role="img" aria-label="Histogram of the errors of '
        f'{len(error)} strokes held out, from {error.min():.4f} to {error.max():.4f}">'
    ]
    for number, count in enumerate(counts):
        tall = _TALL * count / counts.max()
        left = number * _BAR + _SPACE / 2
        parts.append(
            f'<rect x="{left:.1f}" y="{_TALL + 20 - tall:.1f}" width="{_BAR - _SPACE}" height="{tall:.1f}" rx="2"/>'
        )
        if count:
            middle = left + (_BAR - _SPACE) / 2
            parts.append(f'<text x="{middle:.1f}" y="{_TALL + 14 - tall:.1f}" text-anchor="middle">{count}</text>')
    for number in range(0, _BINS + 1, 3):
        anchor = "start" if number == 0 else "end" if number == _BINS else "middle"
        parts.append(f'<text x="{number * _BAR}" y="{_TALL + 42}" text-anchor="{anchor}">{edges[number]:.3f}</text>')
    return "".join([*parts, "</svg>"])


def _data_uri(picture: Tensor) -> str:
    """Returns a picture [3, h, w] in [0, 1] as a PNG data URI; small ones are enlarged."""
    file = io.BytesIO()
    drawn = Image.fromarray(images.to_uint8(picture))
    if drawn.width < _TRAINING_PAGE_WIDTH:
        drawn = drawn.resize(
            (_TRAINING_PAGE_WIDTH, round(drawn.height * _TRAINING_PAGE_WIDTH / drawn.width)), Image.Resampling.BICUBIC
        )
    drawn.quantize(128, dither=Image.Dither.NONE).save(file, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode('ascii')}"
