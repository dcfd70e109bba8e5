"""Pretrained weights by name: fetched on request, checked against fixed hashes, converted once, loaded safely.

`all_weights`: all weights
`words`: weights for painting from words
`find`, `require`: folder of fetched weights
`tensors`: tensors of a network
`fetch`: fetches weights from the first of several sources that gives the right files
"""

from frida_painter.registry import VARIABLE, cache_folder
from frida_painter.weights.cache import Announced, Listener, Notice, Received, Refused, fetch, find, require, tensors
from frida_painter.weights.catalogue import NamedWeights, all_weights, find_weights, words

__all__ = [
    "VARIABLE",
    "Announced",
    "Listener",
    "NamedWeights",
    "Notice",
    "Received",
    "Refused",
    "all_weights",
    "cache_folder",
    "fetch",
    "find",
    "find_weights",
    "require",
    "tensors",
    "words",
]
