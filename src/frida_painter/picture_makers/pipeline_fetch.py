"""Process that fetches a diffusion pipeline from the hub: only settings and safetensors, and never code."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import MakingFailed, WeightsError
from frida_painter.picture_makers.child import run_task, tell
from frida_painter.picture_makers.pipeline_folder import INDEX, choose_weights, parse_index
from frida_painter.weights.hub_folder import ask_hub, fetch_from_hub
from frida_painter.weights.sources import Hub

_SETTINGS = (".json", ".txt", ".model", ".jinja")


def _fetch(task: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Returns the folder of the fetched pipeline in the cache. Raises MakingFailed, ConfigError and StorageError.

    task: name on the hub
    """
    name = task["name"]
    try:
        Hub(name, "main").require(INDEX)  # an unreachable hub costs seconds, not minutes of retries
        index = Path(ask_hub("fetch", name, [INDEX])) / INDEX
        _, parts = parse_index(json.loads(storage.read_bytes(index, "the list of a pipeline", 10**6)), name)
        fetch_from_hub(name, lambda sizes: _choose_files(sizes, parts), tell)
    except (WeightsError, ValueError) as cause:
        why = str(cause).rstrip(".")
        raise MakingFailed(
            f"{name} cannot be fetched from the hub ({why}); check the name and the network, or give a folder."
        ) from cause
    return {"folder": str(index.parent)}


def _choose_files(sizes: Mapping[str, int], parts: Mapping[str, str]) -> list[str]:
    """Returns the settings and weights of the parts; no programs and no pickles."""
    wanted = []
    for part in parts:
        names = [file.removeprefix(f"{part}/") for file in sizes if file.startswith(f"{part}/")]
        settings = [name for name in names if Path(name).suffix in _SETTINGS and "/" not in name]
        wanted += [f"{part}/{name}" for name in (*settings, *choose_weights(names))]
    return wanted


if __name__ == "__main__":
    run_task(_fetch, "The download")
