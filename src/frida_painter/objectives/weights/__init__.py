"""Pretrained weights by name: fetched on request, checked against fixed hashes, converted once, loaded safely."""

from frida_painter.objectives.weights.cache import fetch, find, require, tensors
from frida_painter.objectives.weights.catalogue import NamedWeights, all_weights, find_weights, words
from frida_painter.registry import VARIABLE, cache_folder

__all__ = [
    "VARIABLE",
    "NamedWeights",
    "all_weights",
    "cache_folder",
    "fetch",
    "find",
    "find_weights",
    "require",
    "tensors",
    "words",
]
