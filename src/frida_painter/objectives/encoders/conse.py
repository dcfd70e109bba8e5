"""Words and pictures in one space without CLIP: a picture means what the names of the classes it shows mean.

Norouzi et al. 2013 (ConSE): the classifier says how probable each class is, a sentence encoder what
each class's name means, and the picture's meaning is their mixture.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from importlib import resources

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.devices import Constant
from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.sentence import SentenceEncoder

_SHARPNESS = 0.05  # of similarity, over which a class's share of what is wanted falls to a third


class ConSE:
    """Sees with a classifier and reads with a sentence encoder.

    classifier: its thousand classes are those that are named; names: of each class, one or more; meanings [m, d]: of
    all names, one after the other, of unit length; title: what the classifier is called.
    """

    side = 160

    def __init__(
        self,
        classifier: EfficientNetLite,
        names: Sequence[Sequence[str]],
        meanings: Tensor,
        sentences: SentenceEncoder,
        title: str,
    ) -> None:
        self._classifier = classifier
        self._sentences = sentences
        self._meanings = meanings
        self._owner = torch.repeat_interleave(torch.tensor([len(some) for some in names]))  # [m]
        whole = torch.zeros(len(names), meanings.shape[1]).index_add_(0, self._owner, meanings)
        self._count = len(names)
        self._classes = Constant(functional.normalize(whole, dim=1))  # [classes, d]
        self.title = title

    @property
    def name(self) -> str:
        """As a person is told."""
        return f"{self.title} and the names of its classes (ConSE)"

    def reads_all(self, prompt: str) -> bool:
        """Whether the sentence encoder reads all of the words."""
        return not self._sentences.is_cut_off(prompt)

    def embed_text(self, prompt: str) -> Tensor:
        """The meaning of words, [d], of unit length."""
        return self._sentences.embed([prompt])[0]

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """The mixture of the class names' meanings for pictures [n, 3, h, w]: [n, d], of unit length."""
        return self._mixture(self._seen(pictures))

    def wanted(self, prompt: str) -> Tensor:
        """How much of each class the words ask for, [classes], together 1.

        A class is as near to the words as the nearest of its names.
        """
        similarity = self._meanings @ self.embed_text(prompt)  # [m]
        nearest = torch.full((self._count,), -1.0).scatter_reduce(0, self._owner, similarity, "amax")
        return (nearest / _SHARPNESS).softmax(0)

    def features(self, views: Tensor) -> tuple[Tensor, Tensor]:
        """What the classifier sees where in views [n, 3, h, w]: parts of things, and things."""
        # Channels last: a fifth quicker on CPUs.
        return self._classifier.features(views.contiguous(memory_format=torch.channels_last))

    def distance_to(self, prompt: str) -> Callable[[Tensor], Tensor]:
        """How far pictures [n, 3, h, w] are from what the prompt says, [n]: half cosine distance, half surprise.

        Where nothing that is wanted is probable yet, the mixture's cosine is flat. The surprise, the
        cross-entropy against the classes that are wanted over that of a picture that shows nothing
        (the logarithm of their number), still falls.
        """
        apart = self.distance_of(prompt)
        return lambda pictures: apart(self.features(pictures))

    def distance_of(self, prompt: str) -> Callable[[Sequence[Tensor]], Tensor]:
        """The same of what `features` says of pictures."""
        meaning, wanted = Constant(self.embed_text(prompt)), Constant(self.wanted(prompt))

        def apart(features: Sequence[Tensor]) -> Tensor:
            seen = self._classifier.classified(features[-1]).log_softmax(1)
            surprise = -(seen @ wanted.like(seen)) / math.log(self._count)
            return (1 - self._mixture(seen) @ meaning.like(seen) + surprise) / 2

        return apart

    def _seen(self, pictures: Tensor) -> Tensor:
        """Log probabilities of the classes, [n, classes]."""
        return self._classifier.classified(self.features(pictures)[-1]).log_softmax(1)

    def _mixture(self, seen: Tensor) -> Tensor:
        return functional.normalize(seen.exp() @ self._classes.like(seen), dim=1)


FILE = "class_names.txt"
_LIVING = (range(398), range(991, 998))  # the classes of animals and of mushrooms
_KIN = 6  # classes before and after one, that are of its kind


@cache
def class_names() -> tuple[tuple[str, ...], ...]:
    """The names of each class, in the order of a classifier's scores, such as ("beacon", "lighthouse", ...).

    They are lemmas of WordNet 3.0 (Princeton University 2006), whose licence stands beside this file.
    """
    text = (resources.files(__package__) / FILE).read_text("utf-8")
    return tuple(tuple(line.split(", ")) for line in text.splitlines())


def has_class(noun: str) -> bool:
    """Whether a class of ImageNet is called so, or is a kind of it, as a red fox is a fox."""
    return any(noun.lower() == one.lower().split()[-1] for some in class_names() for one in some)


def synonyms(name: str) -> list[str]:
    """What else the classes of that name are called, as "lady beetle" for "ladybird"; nothing where there is none."""
    plain = name.lower()
    known = [some for some in class_names() if any(plain == one.lower() for one in some)]
    return [one for some in known for one in some if one.lower() != plain]


def kin(name: str) -> list[str]:
    """What living things are called that are most like one, nearest first: "wolf" for "dhole"; nothing for others.

    The classes of animals stand in the order of WordNet's kinds, so that those of a kind stand together. The last
    word of a name says what that is, but where it lives in the sea: a sea cucumber is none.
    """
    names, plain = class_names(), name.lower()
    at = next((number for number, some in enumerate(names) if plain in (one.lower() for one in some)), -1)
    living = next((those for those in _LIVING if at in those), range(0))
    near = sorted((other for other in living if 0 < abs(other - at) <= _KIN), key=lambda other: abs(other - at))
    called = (one.lower() for other in near for one in names[other])
    return list(dict.fromkeys(one if one.startswith("sea ") else one.split()[-1] for one in called))
