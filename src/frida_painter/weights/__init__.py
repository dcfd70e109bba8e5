"""Named pretrained weights: fetched on request, checked against pinned hashes, converted once, loaded without risk.

`known` says which there are, and `words` which painting from words uses; `find` and `require` give the folder of
those that are here; `tensors` loads a network's; `fetch` gets them from the first of several sources that gives the
right files.
"""

from frida_painter.registry import VARIABLE, cache_folder
from frida_painter.weights.cache import Announced, Listener, Notice, Received, Refused, fetch, find, require, tensors
from frida_painter.weights.catalogue import NamedWeights, known, named, words

__all__ = [
    "VARIABLE",
    "Announced",
    "Listener",
    "NamedWeights",
    "Notice",
    "Received",
    "Refused",
    "cache_folder",
    "fetch",
    "find",
    "known",
    "named",
    "require",
    "tensors",
    "words",
]
