"""Words and pictures in one space without CLIP: a picture means what the names of the classes it shows mean.

Norouzi et al. 2013 (ConSE): the classifier says how probable each class is, a sentence encoder what
each class's name means, and the picture's meaning is their mixture.
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter.objectives.encoders.efficientnet import EfficientNetLite
from frida_painter.objectives.encoders.sentence import SentenceEncoder

_SHARPNESS = 0.05  # of likeness, over which a class's share of what is wanted falls to a third


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
        self._classes = functional.normalize(whole, dim=1)  # [classes, d]
        self.title = title

    @property
    def name(self) -> str:
        """As a person is told."""
        return f"{self.title} and the names of its classes (ConSE)"

    def embed_text(self, prompt: str) -> Tensor:
        """The meaning of words, [d], of unit length."""
        return self._sentences.embed([prompt])[0]

    def embed_pictures(self, pictures: Tensor) -> Tensor:
        """The mixture of the class names' meanings for pictures [n, 3, h, w]: [n, d], of unit length."""
        probable = self._classifier.logits(pictures).softmax(1)
        return functional.normalize(probable @ self._classes.to(pictures), dim=1)

    def wanted(self, prompt: str) -> Tensor:
        """How much of each class the words ask for, [classes], together 1.

        A class is as near to the words as the nearest of its names.
        """
        likeness = self._meanings @ self.embed_text(prompt)  # [m]
        nearest = torch.full((len(self._classes),), -1.0).scatter_reduce(0, self._owner, likeness, "amax")
        return (nearest / _SHARPNESS).softmax(0)

    def surprise(self, pictures: Tensor, wanted: Tensor) -> Tensor:
        """How little the classes seen in pictures [n, 3, h, w] are those `wanted` [classes]: [n].

        The cross-entropy over that of a picture that shows nothing, 1. Where the mixture's cosine is flat,
        because nothing that is wanted is probable yet, this still falls.
        """
        seen = self._classifier.logits(pictures).log_softmax(1)
        return -(seen @ wanted.to(pictures)) / math.log(len(self._classes))
