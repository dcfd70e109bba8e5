"""Process that fetches a diffusion pipeline from the hub: only settings and safetensors, and never code."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from frida_painter import storage
from frida_painter.errors import FridaError, MakingFailed
from frida_painter.picture_makers.child import run_task, tell
from frida_painter.picture_makers.pipeline_folder import INDEX, choose_weights, parse_index

_SETTINGS = (".json", ".txt", ".model", ".jinja")
_PATIENCE = 10.0  # seconds for the first answer


def _fetch(task: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Returns the folder of the fetched pipeline in the cache. Raises MakingFailed, ConfigError and StorageError.

    task: name on the hub
    """
    from huggingface_hub import HfApi, constants, hf_hub_download

    name = task["name"]
    try:
        index = Path(hf_hub_download(name, INDEX, etag_timeout=_PATIENCE))
        _, parts = parse_index(json.loads(storage.read_bytes(index, "the list of a pipeline", 10**6)), name)
        found = HfApi().model_info(name, files_metadata=True, timeout=_PATIENCE).siblings or ()
        sizes = {file.rfilename: file.size or 0 for file in found}
        wanted = _choose_files(sizes, parts)
        total = sum(sizes[file] for file in wanted)
        cache = Path(constants.HF_HUB_CACHE)
        storage.require_space(cache, total, f"{name} of the hub")
        tell(f"Fetching {name} from {constants.ENDPOINT} once, {storage.megabytes(total)}.")
        done = 0
        for number, file in enumerate(wanted, 1):
            hf_hub_download(name, file, etag_timeout=_PATIENCE)
            done += sizes[file]
            tell(f"Fetched file {number} of {len(wanted)}, {storage.megabytes(done)} of {storage.megabytes(total)}.")
    except FridaError:
        raise
    except Exception as cause:  # the hub's library raises errors of several others
        first = cause.__cause__ or cause  # the hub's own error only says that something went wrong
        why = " ".join(str(first).split())[:160].rstrip(".") or type(first).__name__
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
