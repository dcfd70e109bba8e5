"""Networks of a painting: the best available one for each purpose, loaded at its first use."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import torch
from torch import Tensor

from frida_painter import registry, storage, tensor_file
from frida_painter.errors import FridaError, WeightsError
from frida_painter.objectives.encoders.base import Encoder, Reader, Seer
from frida_painter.registry import Later, cache_folder

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.sentence import SentenceEncoder
    from frida_painter.objectives.encoders.vgg import Hed, Vgg16


Kept = TypeVar("Kept")

_find_weights = Later("frida_painter.weights:find")
_read_weights = Later("frida_painter.weights:tensors")
_tensor_names = Later("frida_painter.weights.hub_folder:tensor_names")
GROUP = registry.ENCODERS
"""Group of entry points in which packages register their encoders."""
_CLIPS = {"clip-vit-b-32": "CLIP ViT-B/32", "clip-vit-l-14": "CLIP ViT-L/14"}  # the first that is here is used
_CLIP = next(iter(_CLIPS))
CLIP_MISSING = f"CLIP: frida-painter models fetch {_CLIP}"
"""Message for a purpose that CLIP would serve better, if it is not available."""


@dataclass(frozen=True)
class Choice:
    """Record of a network that was used.

    purpose: its task
    used: name of the network
    better: name of a better network that was missing, with the command that fetches it; "" if there is none
    hashes: SHA-256 of its files, if a person named them
    """

    purpose: str
    used: str
    better: str = ""
    hashes: str = ""

    def record(self) -> dict[str, str]:
        """Returns the choice as plain values; hashes only if there are any."""
        return {name: value for name, value in asdict(self).items() if value or name != "hashes"}


_ASIDE = Choice("progress", "EfficientNet-Lite2, kept aside")


class EncoderRegistry:
    """Networks of one painting.

    cache: folder of fetched weights; by default the usual one
    clip: CLIP to use in place of the fetched one: the name of an installed encoder, a folder, a name on the
    hub, or a file of CLIP's ResNet variant
    device: device of the networks for pictures. Pictures on other devices work too, but more slowly.
    pictures: folder of the person's own pictures of objects
    tell: receives a sentence about each wait
    heed: called often in a wait; may raise to end it

    choices: networks used so far
    remarks: notes for the person about the interpretation of the goal

    Methods that load weights raise WeightsError if weights are missing or altered; the message has the command
    that helps.
    """

    def __init__(
        self,
        cache: Path | None = None,
        clip: str | None = None,
        device: torch.device | None = None,
        pictures: Path | None = None,
        tell: Callable[[str], None] = lambda sentence: None,
        heed: Callable[[], None] = lambda: None,
    ) -> None:
        self.cache = cache
        self.tell, self.heed = tell, heed
        self.device = device or torch.device("cpu")
        self._clip_source = clip
        self._pictures = pictures
        self._asked_for_pictures = False
        self._clip: Encoder | None = None
        self._vgg: Vgg16 | None = None
        self._meaning: Seer | None = None
        self._aside: Seer | None = None
        self._edges: Hed | None = None
        self._sentences: SentenceEncoder | None = None
        self._kept_by_name: dict[str, Any] = {}
        self.choices: list[Choice] = []
        self.remarks: list[str] = []

    def style(self) -> "Vgg16":
        """Returns the network for style: VGG16 of ImageNet, or else the trunk of the edge detector."""
        from frida_painter.objectives.encoders.vgg import Vgg16

        if self._vgg is None:
            if _find_weights("vgg16", self.cache) is not None:
                self._vgg = Vgg16.of_torchvision(self._tensors("vgg16"))
                self.choices.append(Choice("style", "VGG16"))
            else:
                self._vgg = Vgg16.of_hed(self._tensors("hed"))
                better = "VGG16 as trained on ImageNet: frida-painter models fetch vgg16"
                self.choices.append(Choice("style", "VGG16 trunk of the edge detector HED", better))
        return self._vgg

    def meaning(self) -> Seer:
        """Returns the network for content: CLIP, or else EfficientNet-Lite0."""
        from frida_painter.objectives.encoders.classifiers import EfficientNetLite

        if self._meaning is None:
            clip = self.clip()
            if clip is not None:
                self._meaning = clip
                self.choices.append(Choice("meaning", clip.name))
            else:
                self._meaning = EfficientNetLite(self._tensors("efficientnet-lite0"))
                self.choices.append(Choice("meaning", "EfficientNet-Lite0", CLIP_MISSING))
        return self._meaning

    @property
    def idle_clip(self) -> str | None:
        """Requested CLIP that was not used so far; None if there is none."""
        return self._clip_source if self._clip is None else None

    @property
    def idle_pictures(self) -> Path | None:
        """Folder of own pictures that was not used so far; None if there is none."""
        return None if self._asked_for_pictures else self._pictures

    def own_pictures(self) -> Path | None:
        """Returns the folder of the person's own pictures of objects, and marks it as used; None if there is none."""
        self._asked_for_pictures = True
        return self._pictures

    def clip(self) -> Encoder | None:
        """Returns the requested or the fetched CLIP; None if there is none."""
        from frida_painter.objectives.encoders.clip import Clip

        if self._clip is None:
            if self._clip_source is not None:
                self._clip = self._load_clip(self._clip_source)
                return self._clip
            for known, called in _CLIPS.items():
                if self._clip is None and (folder := _find_weights(known, self.cache)) is not None:
                    self._clip = Clip.load(folder, called)
        return self._clip

    def clip_of_style(self) -> Seer | None:
        """Returns the CLIP whose layers describe style beside VGG16's; None if there is none."""
        clip = self.clip()
        if clip is not None:
            self._note(Choice("style, beside VGG16", clip.name))
        return clip

    def shapes(self) -> "Vgg16 | None":
        """Returns the network for shapes; None, with a note in `choices`, if neither VGG16 nor HED was fetched."""
        if self._vgg is None and all(_find_weights(name, self.cache) is None for name in ("vgg16", "hed")):
            missing = Choice("shapes", "nothing", "the trunk of HED: frida-painter models fetch hed")
            self._note(missing)
            return None
        return self.style()

    def edges(self) -> "Hed":
        """Returns the edge detector."""
        from frida_painter.objectives.encoders.vgg import Hed

        if self._edges is None:
            self._edges = Hed(self._tensors("hed"))
            self.choices.append(Choice("edges", "HED"))
        return self._edges

    def edges_if_any(self) -> "Hed | None":
        """Returns the edge detector; None if it was not fetched."""
        return None if self._edges is None and _find_weights("hed", self.cache) is None else self.edges()

    def aside(self) -> Seer:
        """Returns the network for the validation, which decides when to stop.

        It differs from the network of the optimiser, unless no other one was fetched.
        """
        from frida_painter.objectives.encoders.classifiers import EfficientNetLite

        if self._aside is None:
            other = _find_weights("efficientnet-lite2", self.cache)
            if other is None:
                better = "an eye kept aside: frida-painter models fetch efficientnet-lite2"
                self.choices.append(Choice("progress", "the same network", better))
                return self.meaning()
            self._aside = EfficientNetLite(self._tensors("efficientnet-lite2"))
            self._note(_ASIDE)
        return self._aside

    @property
    def reads_by_clip(self) -> bool:
        """True if a CLIP, or another encoder of words and pictures in one space, reads the words."""
        return isinstance(self.clip(), Reader)

    @property
    def sees_meaning(self) -> bool:
        """True if the network for content is here."""
        return self.clip() is not None or self._has("efficientnet-lite0")

    @property
    def composes(self) -> bool:
        """True if the network is here that finds pictures for words."""
        return self._has("minilm")

    def reader(self) -> Reader:
        """Returns the encoder of words and pictures in one space: the CLIP."""
        clip: object = self.clip()
        if not isinstance(clip, Reader):
            raise WeightsError(
                f"To read words in pictures needs a CLIP; fetch it with `frida-painter models fetch {_CLIP}`."
            )
        self._note(Choice("words", clip.name))
        return clip

    def sentences(self) -> "SentenceEncoder":
        """Returns the encoder of words alone, by which pictures are found for them."""
        from frida_painter.objectives.encoders.sentence import SentenceEncoder

        if self._sentences is None:
            if not self.composes:
                raise WeightsError(
                    "Painting from words needs minilm, not here yet; fetch with `frida-painter models fetch words`."
                )
            self._sentences = SentenceEncoder.load(self.cache)
            self._note(Choice("words", "pictures by their captions (MiniLM)", CLIP_MISSING))
        return self._sentences

    def keep(self, name: str, make: Callable[[], Kept]) -> Kept:
        """Returns the result of `make`, cached under that name as long as the networks; for other modules.

        None is not cached: the next call makes the result again.
        """
        if self._kept_by_name.get(name) is None:
            self._kept_by_name[name] = make()
        return cast(Kept, self._kept_by_name[name])

    def remark(self, words: str) -> None:
        """Adds a note for the person, once."""
        if words not in self.remarks:
            self.remarks.append(words)

    def _note(self, choice: Choice) -> None:
        """Adds a choice, once."""
        if choice not in self.choices:
            self.choices.append(choice)

    @property
    def meanings(self) -> Path:
        """Folder of cached embeddings of names."""
        return cache_folder(self.cache) / "meanings"

    def _has(self, name: str) -> bool:
        return _find_weights(name, self.cache) is not None

    def _tensors(self, name: str) -> dict[str, Tensor]:
        return {part: tensor.to(self.device) for part, tensor in _read_weights(name, self.cache).items()}

    def _load_clip(self, source: str) -> Encoder:
        """Returns the encoder of an installed package, or the CLIP of a file, a folder or a hub's name."""
        from frida_painter.objectives.encoders.clip import Clip, ClipResNet

        for point in entry_points(group=GROUP, name=source):
            return _load_plugin(point, self.device)
        path = storage.in_home(source)
        if storage.exists(path) and any(name.startswith("visual.layer1.") for name in _tensor_names(path)):
            tensors, _ = tensor_file.read_tensors(path, "the weights of a CLIP", WeightsError)
            return ClipResNet({name: tensor.to(self.device) for name, tensor in tensors.items()}, f"CLIP {path.stem}")
        return Clip.load(source, cache=self.cache, tell=self.tell, heed=self.heed)


def _load_plugin(point: EntryPoint, device: torch.device) -> Encoder:
    """Returns an encoder of another package. Raises WeightsError if it cannot be used."""
    package = f" of {point.dist.name}" if point.dist is not None else ""
    try:
        encoder = point.load()(device)
    except FridaError:
        raise
    except Exception as error:  # foreign code may raise anything
        raise WeightsError(
            f"The encoder {point.name!r}{package} cannot be used ({type(error).__name__}: {error}); "
            "mend that package, or paint without --clip."
        ) from error
    if not isinstance(encoder, Encoder):
        raise WeightsError(
            f"The encoder {point.name!r}{package} is a {type(encoder).__name__}, which sees nothing; it needs a name "
            "and the method features."
        )
    return encoder
