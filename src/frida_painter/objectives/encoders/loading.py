"""Networks of a painting: the best available one for each purpose, loaded at its first use."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import torch
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import FridaError, WeightsError
from frida_painter.objectives.encoders.base import Encoder, Reader, Seer
from frida_painter.registry import Later, cache_folder

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.convolutional import Hed, Vgg16
    from frida_painter.objectives.encoders.sentence import SentenceEncoder


Kept = TypeVar("Kept")
_find_weights = Later("frida_painter.objectives.weights:find")
_read_weights = Later("frida_painter.objectives.weights:tensors")
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
    """

    purpose: str
    used: str
    better: str = ""


class EncoderRegistry:
    """Networks of one painting.

    cache: folder of fetched weights; by default the usual one
    clip: CLIP to use in place of the fetched one: the name of an installed encoder, a folder or its file of
    weights, or a name on the hub
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
        self._clip_source, self._pictures = clip, pictures
        self._asked_for_pictures = False
        self._clip: Encoder | None = None
        self._loaded: dict[str, Any] = {}
        self.choices: list[Choice] = []
        self.remarks: list[str] = []

    def style(self) -> "Vgg16":
        """Returns the network for style: VGG16 of ImageNet, or else the trunk of the edge detector."""
        from frida_painter.objectives.encoders.convolutional import Vgg16

        if self._has("vgg16"):
            return self._load("vgg16", Vgg16.of_torchvision, Choice("style", "VGG16"))
        better = "VGG16 as trained on ImageNet: frida-painter models fetch vgg16"
        return self._load("hed", Vgg16.of_hed, Choice("style", "VGG16 trunk of the edge detector HED", better))

    def meaning(self) -> Seer:
        """Returns the network for content: CLIP, or else EfficientNet-Lite0."""
        from frida_painter.objectives.encoders.convolutional import EfficientNetLite

        clip = self.clip()
        if clip is not None:
            self._note(Choice("meaning", clip.name))
            return clip
        choice = Choice("meaning", "EfficientNet-Lite0", CLIP_MISSING)
        return self._load("efficientnet-lite0", EfficientNetLite, choice)

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

        source = self._clip_source
        if self._clip is None and source is not None:
            point = next(iter(entry_points(group=GROUP, name=source)), None)
            if point is not None:
                self._clip = _load_plugin(point, self.device)
            else:
                self._clip = Clip.load(source, cache=self.cache, tell=self.tell, heed=self.heed)
        elif self._clip is None:
            found = ((_find_weights(known, self.cache), called) for known, called in _CLIPS.items())
            self._clip = next((Clip.load(folder, called) for folder, called in found if folder is not None), None)
        return self._clip

    def clip_of_style(self) -> Seer | None:
        """Returns the CLIP whose layers describe style beside VGG16's; None if there is none."""
        clip = self.clip()
        if clip is not None:
            self._note(Choice("style, beside VGG16", clip.name))
        return clip

    def shapes(self) -> "Vgg16 | None":
        """Returns the network for shapes; None, with a note in `choices`, if neither VGG16 nor HED was fetched."""
        if self._has("vgg16") or self._has("hed"):
            return self.style()
        self._note(Choice("shapes", "nothing", "the trunk of HED: frida-painter models fetch hed"))
        return None

    def edges(self) -> "Hed":
        """Returns the edge detector."""
        from frida_painter.objectives.encoders.convolutional import Hed

        return self._load("hed", Hed, Choice("edges", "HED"))

    def edges_if_any(self) -> "Hed | None":
        """Returns the edge detector; None if it was not fetched."""
        return self.edges() if self._has("hed") else None

    def aside(self) -> Seer:
        """Returns the network for the validation, which decides when to stop.

        It differs from the network of the optimiser, unless no other one was fetched.
        """
        from frida_painter.objectives.encoders.convolutional import EfficientNetLite

        if not self._has("efficientnet-lite2"):
            better = "an eye kept aside: frida-painter models fetch efficientnet-lite2"
            self._note(Choice("progress", "the same network", better))
            return self.meaning()
        return self._load("efficientnet-lite2", EfficientNetLite, Choice("progress", "EfficientNet-Lite2, kept aside"))

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

        if "minilm" not in self._loaded:
            if not self.composes:
                raise WeightsError(
                    "Painting from words needs minilm, not here yet; fetch with `frida-painter models fetch words`."
                )
            self._loaded["minilm"] = SentenceEncoder.load(self.cache)
            self._note(Choice("words", "pictures by their captions (MiniLM)", CLIP_MISSING))
        return cast("SentenceEncoder", self._loaded["minilm"])

    def keep(self, name: str, make: Callable[[], Kept]) -> Kept:
        """Returns the result of `make`, cached under that name as long as the networks; for other modules.

        None is not cached: the next call makes the result again.
        """
        if self._loaded.get(name) is None:
            self._loaded[name] = make()
        return cast(Kept, self._loaded[name])

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
        return registry.are_here(name, self.cache)

    def _load(self, name: str, make: Callable[[dict[str, Tensor]], Kept], choice: Choice) -> Kept:
        """Returns the network that is made of these weights, the same for the same choice, and notes the choice."""
        key = f"{name}, {choice.purpose}"
        if key not in self._loaded:
            tensors = _read_weights(name, self.cache)
            self._loaded[key] = make({part: tensor.to(self.device) for part, tensor in tensors.items()})
            self._note(choice)
        return cast(Kept, self._loaded[key])


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
