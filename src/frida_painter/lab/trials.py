"""Parts of experiments: outcomes with tables, notes and pictures; trials; measures of pictures."""

import hashlib
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Generic, TypeVar

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from torch import Tensor
from torch.nn import functional

from frida_painter import images, storage
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ImageError, StorageError
from frida_painter.frames import PixelGrid
from frida_painter.objectives.encoders.base import Seer
from frida_painter.objectives.encoders.vgg import Vgg16
from frida_painter.objectives.semantic_loss import Views
from frida_painter.objectives.style_flow import directions
from frida_painter.strokes import Strokes

Value = str | int | float | bool | None
Row = Mapping[str, Value]
Task = TypeVar("Task")


@dataclass(frozen=True)
class Progress:
    """Progress of an experiment.

    share: of the work that is done, in [0, 1]
    doing: current work in words
    """

    share: float
    doing: str


Notify = Callable[[Progress], None]


def silent(progress: Progress) -> None:
    """Ignores progress."""


def within(notify: Notify, first: float, last: float) -> Notify:
    """Returns a listener for a part that takes an experiment from share `first` to share `last`."""
    return lambda progress: notify(Progress(first + (last - first) * progress.share, progress.doing))


def each(tasks: Sequence[Task], notify: Notify) -> Iterator[tuple[Task, Notify]]:
    """Yields the tasks, assumed to be equally long, each with a listener for its own progress."""
    for number, task in enumerate(tasks):
        yield task, within(notify, number / len(tasks), (number + 1) / len(tasks))


@dataclass(frozen=True)
class ResultTable:
    """Table of results.

    title: above the table
    rows: all with the columns of the first one
    """

    title: str
    rows: tuple[Row, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(self.rows[0]) if self.rows else ()

    def markdown(self) -> str:
        """Returns the table in Markdown, numbers at the right and with four significant digits."""
        numeric = {name: all(_is_number(row[name]) for row in self.rows) for name in self.columns}
        lines = [
            _line(self.columns),
            _line(["---:" if numeric[name] else "---" for name in self.columns]),
            *(_line([_format_value(row[name]) for name in self.columns]) for row in self.rows),
        ]
        return f"**{self.title}**\n\n" + "\n".join(lines) + "\n"


@dataclass(frozen=True)
class Outcome:
    """Outcome of an experiment.

    name: of the command
    title: one line for people
    settings: all parameters of the run, including seeds
    tables: results
    notes: sentences that explain the tables
    pictures: sRGB [3, H, W] in [0, 1], by the name of the file without its ending
    """

    name: str
    title: str
    settings: Mapping[str, Value | Sequence[Value]]
    tables: tuple[ResultTable, ...]
    notes: tuple[str, ...] = ()
    pictures: Mapping[str, Tensor] = field(default_factory=dict)

    def markdown(self) -> str:
        """Returns the outcome as a Markdown page."""
        parts = [f"# {self.title}\n", *(f"{note}\n" for note in self.notes)]
        parts += [f"![{name.replace('-', ' ')}]({name}.png)\n" for name in self.pictures]
        parts += [table.markdown() for table in self.tables]
        parts.append("Settings: " + "; ".join(f"{name} {_list_names(value)}" for name, value in self.settings.items()))
        return "\n".join(parts) + "\n"

    def record(self) -> dict[str, object]:
        """Returns the outcome as plain values; numbers that are not finite become null."""
        return {
            "format": "frida-painter experiment",
            "experiment": self.name,
            "title": self.title,
            "settings": {name: value if _plain(value) else list(value) for name, value in self.settings.items()},  # type: ignore[arg-type]
            "notes": list(self.notes),
            "tables": [
                {"title": table.title, "rows": [{name: _finite(row[name]) for name in row} for row in table.rows]}
                for table in self.tables
            ],
            "pictures": [f"{name}.png" for name in self.pictures],
        }

    def save(self, folder: Path) -> None:
        """Writes table.json, table.md and the pictures to `folder`. Raises StorageError."""
        for name, picture in self.pictures.items():
            images.save(picture, folder / f"{name}.png")
        storage.write_text(folder / "table.md", self.markdown())
        storage.write_json(folder / "table.json", self.record())


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _is_number(value: Value) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _format_value(value: Value) -> str:
    """Returns a value as people read it."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value).replace("|", r"\|")


def _list_names(value: Value | Sequence[Value]) -> str:
    return _format_value(value) if _plain(value) else ", ".join(_format_value(part) for part in value)  # type: ignore[union-attr, arg-type]


def _plain(value: Value | Sequence[Value]) -> bool:
    return value is None or isinstance(value, str | int | float)


def _finite(value: Value) -> Value:
    return None if isinstance(value, float) and not math.isfinite(value) else value


# Experiments: a list of trials, a measurement of each, and a report about all.
# A trial is independent. It contains everything that its measurement depends on, so that trials can run in any order
# and in any process. Finished ones are stored on the disk, and an interrupted experiment continues from there.

Labels = Mapping[str, str | int]
"""Labels that distinguish a trial from the others: the first columns of its row in the table of results."""


@dataclass(frozen=True)
class ExperimentTrial:
    """Trial: one part of an experiment.

    labels: distinguish it from the others
    depends_on: plain values that determine its measurement, besides the labels
    """

    labels: Labels
    depends_on: Mapping[str, object] = field(default_factory=dict)

    def __getitem__(self, label: str) -> str:
        """Returns a label as text."""
        return str(self.labels[label])

    @property
    def name(self) -> str:
        """Name for its files, from the labels."""
        return re.sub(r"[^\w.]+", "-", "-".join(map(str, self.labels.values()))).strip("-.")

    @property
    def fingerprint(self) -> str:
        """sha256 of everything that determines the measurement, including the version of this program."""
        everything = [version("frida-painter"), dict(self.labels), dict(self.depends_on)]
        return hashlib.sha256(json.dumps(everything, sort_keys=True).encode()).hexdigest()


AnyTrial = TypeVar("AnyTrial", bound=ExperimentTrial)


@dataclass(frozen=True)
class Measurement:
    """Measurement of a trial: numbers by name, and pictures [3, H, W] by name."""

    numbers: Mapping[str, float]
    pictures: Mapping[str, Tensor] = field(default_factory=dict)


@dataclass(frozen=True)
class Results:
    """Measurements of all trials, in order, with their labels."""

    found: tuple[tuple[Labels, Measurement], ...]

    def having(self, **labels: str | int) -> list[Measurement]:
        """Returns the measurements of the trials with these labels."""
        return [found for its, found in self.found if all(its[name] == value for name, value in labels.items())]

    def one(self, **labels: str | int) -> Measurement:
        """Returns the measurement of the only trial with these labels."""
        (found,) = self.having(**labels)
        return found

    def values(self, number: str, **labels: str | int) -> list[float]:
        """Returns one of the numbers for all trials with these labels."""
        return [found.numbers[number] for found in self.having(**labels)]

    def mean(self, number: str, **labels: str | int) -> float:
        """Returns the mean of `values`."""
        return float(np.mean(self.values(number, **labels)))

    def rows(self) -> tuple[Row, ...]:
        """Returns a table with a row for every trial: its labels and its numbers."""
        return tuple({**labels, **found.numbers} for labels, found in self.found)

    def means(self, label: str) -> tuple[Row, ...]:
        """Returns a table with a row for every value of a label: the means of all numbers."""
        values = dict.fromkeys(its[label] for its, _ in self.found)
        names = list(self.found[0][1].numbers)
        return tuple({label: value, **{name: self.mean(name, **{label: value}) for name in names}} for value in values)


@dataclass(frozen=True)
class Experiment(Generic[AnyTrial]):
    """Experiment: trials, a measurement and a report.

    trials: its parts
    measure: measures one trial, and reports its progress
    report: makes the outcome of all measurements
    sharing: label; trials that differ only in this label share work, and one process measures them
    """

    trials: Sequence[AnyTrial]
    measure: Callable[[AnyTrial, Notify], Measurement]
    report: Callable[[Results], Outcome]
    sharing: str = ""

    def run(self, keep: Path | None = None, notify: Notify = silent) -> Outcome:
        """Measures every trial that is not in `keep`, and returns the outcome.

        keep: folder that stores finished trials in case of an interruption; None to store nothing
        notify: hears the progress

        Raises the errors of `measure`, and StorageError.
        """
        found = []
        for trial, telling in each(self.trials, notify):
            found.append((trial.labels, self.measure_or_load(trial, keep, telling)))
        return self.report(Results(tuple(found)))

    def shares(self, keep: Path) -> list[tuple[int, ...]]:
        """Returns the numbers of the trials that are not in `keep`, grouped by shared work."""
        found: dict[str, list[int]] = {}
        for number, trial in enumerate(self.trials):
            if _read(keep, trial) is None:
                rest = {name: value for name, value in trial.labels.items() if name != self.sharing}
                found.setdefault(json.dumps(rest), []).append(number)
        return [tuple(numbers) for numbers in found.values()]

    def measure_or_load(self, trial: AnyTrial, keep: Path | None, notify: Notify) -> Measurement:
        """Returns the measurement of a trial, from `keep` if it is stored there.

        Raises StorageError and the errors of `measure`.
        """
        if keep is None:
            return self.measure(trial, notify)
        measured = _read(keep, trial)
        if measured is None:
            measured = self.measure(trial, notify)
            _keep(keep, trial, measured)
        return measured


def _keep(folder: Path, trial: ExperimentTrial, measured: Measurement) -> None:
    for name, picture in measured.pictures.items():
        images.save(picture, folder / f"{trial.name}-{name}.png")
    record = {"of": trial.fingerprint, "numbers": dict(measured.numbers), "pictures": list(measured.pictures)}
    storage.write_json(folder / f"{trial.name}.json", record)


def _read(folder: Path, trial: ExperimentTrial) -> Measurement | None:
    """Returns a stored measurement, with pictures in 8 bits; None if it is missing, outdated or damaged."""
    try:
        record = storage.read_json(folder / f"{trial.name}.json", "a measurement of an experiment")
        if record["of"] != trial.fingerprint:
            return None
        pictures = {name: images.load(folder / f"{trial.name}-{name}.png") for name in record["pictures"]}
    except (StorageError, ImageError, KeyError):
        return None
    return Measurement(record["numbers"], pictures)


# Measures of the distance between a painting and its goal that its planner did not optimise.

_SIGMA = 1.5  # pixels, of the windows of SSIM
_ROWS = 256  # of the pictures in which edges are detected
_BLUR = 1.6  # its pixels
_LOW, _HIGH = 40, 100  # of 255: slopes at which Canny's edges continue and start
_TOLERANCE = 0.015  # of the picture's diagonal
_AREA = 12  # its pixels: half the width over which a composition's edges are measured
_VIEWS = 6


def mse(picture: Tensor, target: Tensor) -> float:
    """Returns the mean squared difference of two pictures [3, H, W] in [0, 1]."""
    return float((picture - target).square().mean())


def psnr(picture: Tensor, target: Tensor) -> float:
    """Returns the peak signal-to-noise ratio of two pictures [3, H, W] in [0, 1], in dB."""
    return -10 * float((picture - target).square().mean().clamp(min=1e-12).log10())


def ssim(picture: Tensor, target: Tensor) -> float:
    """Returns the structural similarity of two pictures [3, H, W] in [0, 1], mean over channels and windows.

    The windows are Gaussian, as published (Wang et al. 2004).
    """
    from skimage.metrics import structural_similarity  # loaded here because few experiments need it

    one, other = (each.detach().permute(1, 2, 0).double().numpy() for each in (picture, target))
    found = structural_similarity(
        one, other, channel_axis=2, data_range=1.0, gaussian_weights=True, sigma=_SIGMA, use_sample_covariance=False
    )
    return float(found)


def near_borders(regions: Tensor) -> Tensor:
    """Returns the pixels within one pixel of a border between two regions of a map [H, W]: [H, W] of bool."""
    down, across = regions[1:] != regions[:-1], regions[:, 1:] != regions[:, :-1]
    border = functional.pad(down, (0, 0, 0, 1)) | functional.pad(down, (0, 0, 1, 0))
    border |= functional.pad(across, (0, 1)) | functional.pad(across, (1, 0))
    return border


@torch.no_grad()
def feature_distance(seer: Seer, picture: Tensor, target: Tensor, side: int, seed: int = 0) -> float:
    """Returns the mean cosine distance, in [0, 2], of a network's features, over layers, places and several views.

    picture, target: [3, H, W] in [0, 1]
    side: pixels of a view
    """
    views, which = Views(_VIEWS, side, seed), torch.arange(_VIEWS)
    seen, wanted = seer.features(views.of(picture, which)), seer.features(views.of(target, which))
    return float(np.mean([_cosine(a, b) for a, b in zip(seen, wanted, strict=True)]))


@torch.no_grad()
def perceptual_distance(vgg: Vgg16, picture: Tensor, target: Tensor) -> float:
    """Returns a distance like LPIPS (Zhang et al. 2018), without its learned weights of channels.

    It is the mean squared difference of unit features of five layers of VGG16, averaged over places and layers.
    """
    layers = ("conv1_2", "conv2_2", "conv3_3", "conv4_3", "conv5_3")
    a, b = vgg.features(picture, layers), vgg.features(target, layers)
    return float(np.mean([2 * _cosine(x[None], y[None]) for x, y in zip(a, b, strict=True)]))


def edge_score(picture: Tensor, target: Tensor) -> float:
    """Returns the agreement of the edges of two pictures [3, H, W]: the F-score of Canny's edges, in [0, 1].

    Two edges match if their distance is at most 1.5 % of the picture's diagonal.
    """
    found, wanted = _edges(picture), _edges(target)
    reach = _TOLERANCE * float(np.hypot(*wanted.shape))
    precision, recall = _share_near(found, wanted, reach), _share_near(wanted, found, reach)
    return 2 * precision * recall / (precision + recall) if precision + recall > 0 else 0.0


def edge_correlation(picture: Tensor, target: Tensor) -> float:
    """Returns the correlation, in [-1, 1], of the coarse edges of lightness of two pictures, place by place.

    target: cropped to the shape of `picture` [3, H, W]
    """
    steps = [_steps(images.fit(one, *_shape(picture)).mean(0)).flatten() for one in (picture, target)]
    return float(torch.corrcoef(torch.stack(steps))[0, 1])


def direction_agreement(strokes: Strokes, style: Tensor, size: CanvasSize) -> float:
    """Returns the agreement of strokes with the directions of a style picture: circular correlation, in [-1, 1].

    It is the mean cosine of twice the angle between a stroke and the style's direction in its middle (opposite
    angles are the same direction). The weight of a stroke is its length times the clarity of the direction of the
    style [3, H, W], cropped to the canvas. 1 means the same directions, 0 no relation, -1 perpendicular ones.
    """
    filled = images.fit(style, _ROWS, round(_ROWS * size.width / size.height))
    doubled, coherence, _ = directions(filled)
    middle = PixelGrid(size, *doubled.shape).to_pixels(strokes.path(torch.tensor([0.5]))[:, 0]).round().long()
    columns, rows = (middle[:, axis].clamp(0, most - 1) for axis, most in enumerate(reversed(doubled.shape)))
    weight = coherence[rows, columns] * strokes.length
    return float((weight * torch.cos(2 * strokes.angle - doubled[rows, columns])).sum() / weight.sum().clamp(min=1e-9))


def exact_emd(cost: Tensor) -> float:
    """Returns the Earth Mover's Distance for a square cost [n, n] between two clouds of n equal weights.

    The best transport between equal weights is an assignment, so this is exact.
    """
    values = cost.detach().cpu().double().numpy()
    rows, columns = linear_sum_assignment(values)
    return float(values[rows, columns].mean())


def _cosine(a: Tensor, b: Tensor) -> float:
    return float((1 - functional.cosine_similarity(a, b, dim=1)).mean())


def _edges(picture: Tensor) -> NDArray[np.bool_]:
    """Returns Canny's edges [h, w] of a blurred picture; the blur removes the grain of a brush."""
    pixels = images.to_uint8(images.fit(picture, *_shape(picture)))
    gray = cv2.GaussianBlur(cv2.cvtColor(pixels, cv2.COLOR_RGB2GRAY), (0, 0), _BLUR)
    found: NDArray[np.bool_] = cv2.Canny(gray, _LOW, _HIGH, L2gradient=True) > 0
    return found


def _steps(gray: Tensor) -> Tensor:
    """Returns the gradient of lightness [h, w] at the scale of areas, not of marks."""
    smooth = functional.avg_pool2d(gray[None, None], 2 * _AREA + 1, 1, _AREA, count_include_pad=False)[0, 0]
    across = smooth[_AREA:-_AREA, 2 * _AREA :] - smooth[_AREA:-_AREA, : -2 * _AREA]
    down = smooth[2 * _AREA :, _AREA:-_AREA] - smooth[: -2 * _AREA, _AREA:-_AREA]
    return (across.square() + down.square()).sqrt()


def _shape(picture: Tensor) -> tuple[int, int]:
    return _ROWS, round(_ROWS * picture.shape[2] / picture.shape[1])


def _share_near(edges: NDArray[np.bool_], others: NDArray[np.bool_], reach: float) -> float:
    """Returns the share of edges that have another edge within `reach` pixels."""
    if not edges.any() or not others.any():
        return 0.0
    away = cv2.distanceTransform((~others).astype(np.uint8), cv2.DIST_L2, 5)
    return float((away[edges] <= reach).mean())
