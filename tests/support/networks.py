"""Small or random networks in place of those that are fetched."""

import json
import zipfile
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import torch
from torch.nn import functional
from torch.nn.functional import avg_pool2d

from frida_painter.objectives.encoders.convolutional import EfficientNetLite, Hed, Vgg16
from frida_painter.objectives.encoders.loading import Choice, EncoderRegistry
from frida_painter.objectives.encoders.sentence import SentenceEncoder
from frida_painter.system.devices import Constant
from frida_painter_words.libraries import PictureArchive
from frida_painter_words.retrieval import PictureIndex

Kept = TypeVar("Kept")


@cache
def random_vgg_tensors() -> dict[str, torch.Tensor]:
    """Tensors of the shapes and names of VGG16's convolutions, of random weights that keep signals alive."""
    chance = torch.Generator().manual_seed(0)
    sizes = [3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512]
    tensors = {}
    for position, before, size in zip((0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28), sizes, sizes[1:], strict=False):
        tensors[f"features.{position}.weight"] = (
            torch.randn(size, before, 3, 3, generator=chance) * (2 / (9 * before)) ** 0.5
        )
        tensors[f"features.{position}.bias"] = torch.zeros(size)
    return tensors


@cache
def random_hed_tensors() -> dict[str, torch.Tensor]:
    """Tensors of the shapes and names of HED's: the trunk, five sides and their fusion."""
    chance = torch.Generator().manual_seed(1)
    tensors = dict(random_vgg_tensors())
    for side, size in enumerate((64, 128, 256, 512, 512), 1):
        tensors[f"dsn{side}.weight"] = torch.randn(1, size, 1, 1, generator=chance) / size
        tensors[f"dsn{side}.bias"] = torch.zeros(1)
    tensors["fuse.weight"] = torch.full((1, 5, 1, 1), 0.2)
    tensors["fuse.bias"] = torch.zeros(1)
    return tensors


@cache
def random_lite_tensors() -> dict[str, torch.Tensor]:
    """Tensors named as EfficientNet-Lite's, of a network that is as deep and much narrower."""
    chance = torch.Generator().manual_seed(0)
    tensors: dict[str, torch.Tensor] = {}

    def convolution(name: str, norm: str, out: int, before: int, kernel: int) -> None:
        spread = (2 / (before * kernel**2)) ** 0.5
        tensors[f"{name}.weight"] = torch.randn(out, before, kernel, kernel, generator=chance) * spread
        tensors[f"{norm}.weight"] = 0.5 + torch.rand(out, generator=chance)
        tensors[f"{norm}.bias"] = 0.1 * torch.randn(out, generator=chance)
        tensors[f"{norm}.running_mean"] = 0.1 * torch.randn(out, generator=chance)
        tensors[f"{norm}.running_var"] = 0.5 + torch.rand(out, generator=chance)

    convolution("_conv_stem", "_bn0", 4, 3, 3)
    channels = 4
    for number, (out, kernel) in enumerate([(3, 3), (5, 3), (5, 3), (6, 5), (7, 3), (8, 5), (9, 5), (10, 3)]):
        name, inner = f"_blocks.{number}", channels
        if number:
            inner = 2 * channels
            convolution(f"{name}._expand_conv", f"{name}._bn0", inner, channels, 1)
        convolution(f"{name}._depthwise_conv", f"{name}._bn1", inner, 1, kernel)
        convolution(f"{name}._project_conv", f"{name}._bn2", out, inner, 1)
        channels = out
    convolution("_conv_head", "_bn1", 16, channels, 1)
    tensors["_fc.weight"], tensors["_fc.bias"] = torch.randn(1000, 16, generator=chance), torch.zeros(1000)
    return tensors


class QuickVgg(Vgg16):
    """Random mixtures of colours, coarser from layer to layer, in place of convolutions."""

    def __init__(self) -> None:
        pass

    def features(self, picture: torch.Tensor, layers: Sequence[str]) -> list[torch.Tensor]:
        chance = torch.Generator().manual_seed(0)
        mixtures = [torch.randn(8, 3, generator=chance) for _ in layers]
        return [
            torch.einsum("oc,chw->ohw", mixture.to(picture), avg_pool2d(picture, 4 + 2 * depth)).relu()
            for depth, mixture in enumerate(mixtures)
        ]


class QuickHed(Hed):
    """The slope of the lightness in place of a network."""

    def __init__(self) -> None:
        pass

    def edges(self, picture: torch.Tensor) -> torch.Tensor:
        gray = picture.mean(0)
        across = functional.pad(gray[:, 2:] - gray[:, :-2], (1, 1))
        down = functional.pad(gray[2:] - gray[:-2], (0, 0, 1, 1))
        return torch.tanh(4 * (across.square() + down.square()))


class WordBag(SentenceEncoder):
    """Sentences are the sum of their words, each of which is a direction of its own: no network is needed."""

    def __init__(self) -> None:
        pass

    def embed(self, sentences: Sequence[str]) -> torch.Tensor:
        return torch.nn.functional.normalize(torch.stack([self._sum(sentence) for sentence in sentences]), dim=1)

    def _sum(self, sentence: str) -> torch.Tensor:
        words = [word.strip(",") for word in sentence.lower().split() if word not in ("a", "an", "the")]
        return torch.stack([_direction(word) for word in words]).sum(0)


@cache
def _direction(word: str) -> torch.Tensor:
    return torch.randn(256, generator=torch.Generator().manual_seed(zlib.crc32(word.encode())))


class RandomReader:
    """Words and pictures in one space, as a CLIP has them, by a random mixture of a picture's coarse cells."""

    name, side = "a random network", 32

    def __init__(self) -> None:
        self._mixture = Constant(torch.randn(192, 256, generator=torch.Generator().manual_seed(0)))

    def reads_all(self, prompt: str) -> bool:
        return len(prompt.split()) <= 70

    def embed_text(self, prompt: str) -> torch.Tensor:
        return WordBag().embed([prompt])[0]

    def embed_pictures(self, pictures: torch.Tensor) -> torch.Tensor:
        cells = torch.tanh(avg_pool2d(pictures, 4).flatten(1) - 0.5)
        return functional.normalize(cells @ self._mixture.like(pictures), dim=1)


class QuickEncoders(EncoderRegistry):
    """Sees through random mixtures: enough for everything but judging what is seen."""

    def style(self) -> Vgg16:
        if not self.choices:
            self.choices.append(Choice("style", "random mixtures", "VGG16"))
        return QuickVgg()

    def meaning(self) -> EfficientNetLite:
        return EfficientNetLite(random_lite_tensors())

    def shapes(self) -> Vgg16:
        return QuickVgg()

    def edges(self) -> Hed:
        return QuickHed()

    def edges_if_any(self) -> Hed:
        return self.edges()

    def aside(self) -> EfficientNetLite:
        return self.meaning()

    def sentences(self) -> SentenceEncoder:
        if not self.choices:
            self.choices.append(Choice("words", "a bag of words", "CLIP"))
        return WordBag()

    def keep(self, name: str, make: Callable[[], Kept]) -> Kept:
        """Knows only the pictures that a test put under "picture index"."""
        known = {"picture index": PictureIndex([], self.sentences(), Path(), self.remark), **self.own}
        if name not in known:
            known[name] = self.own[name] = make()
        return cast(Kept, known[name])

    @property
    def own(self) -> dict[str, Any]:
        """Picture index of a test."""
        return self.__dict__.setdefault("_own", {})


def index_of(folder: Path) -> PictureIndex:
    """The pictures of `write_drawings`, found by a bag of words."""
    drawings = PictureArchive("drawings", "Somebody, CC BY-SA 4.0", write_drawings(folder / "pictures.zip"))
    return PictureIndex([drawings], WordBag(), folder, print)


def write_drawings(path: Path) -> Path:
    """An archive with a red square of 20 in 72, called strawberry, and a bare outline, called umbrella."""
    outline = '<g><rect x="10" y="10" width="20" height="20" fill="none" stroke="#000" stroke-width="2"/></g>'
    svg = '<svg viewBox="0 0 72 72" xmlns="http://www.w3.org/2000/svg">{}</svg>'
    with zipfile.ZipFile(path, "w") as archive:
        red = '<rect x="10" y="10" width="20" height="20" fill="#ff0000"/>'
        archive.writestr("1.svg", svg.format(red))
        archive.writestr("2.svg", svg.format(outline))
        archive.writestr("captions.json", json.dumps({"1.svg": ["strawberry"], "2.svg": ["umbrella"]}))
    return path


class NoEncoderRegistry(EncoderRegistry):
    """Fails the test when any network is asked for."""

    def style(self) -> Vgg16:
        raise AssertionError("a network was asked for")

    def meaning(self) -> EfficientNetLite:
        raise AssertionError("a network was asked for")
