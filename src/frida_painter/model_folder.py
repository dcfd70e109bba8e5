"""Where the weights of networks are kept on this machine: <cache>/<name>/, with a record that is written last."""

import os
from pathlib import Path

import platformdirs

VARIABLE = "FRIDA_PAINTER_MODELS"
RECORD = "record.json"


def cache_folder(cache: Path | None = None) -> Path:
    """The folder of weights: `cache`, or what FRIDA_PAINTER_MODELS says, or the one that the system gives to caches."""
    if cache is not None:
        return cache
    if os.environ.get(VARIABLE):
        return Path(os.environ[VARIABLE]).expanduser()
    return platformdirs.user_cache_path("frida-painter", appauthor=False) / "models"


def are_here(name: str, cache: Path | None = None) -> bool:
    """Whether weights of that name were fetched. Only a glance: weights/cache.py checks them whenever they are used."""
    return (cache_folder(cache) / name / RECORD).is_file()
