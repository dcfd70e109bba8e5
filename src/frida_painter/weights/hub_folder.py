"""Folder of a network by any of its names: in the catalogue, on the hub of `transformers`, or as its authors call it.

Only settings, vocabulary and tensors are fetched, once; code beside them stays where it is.
"""

import os
import re
from pathlib import Path

from frida_painter.errors import WeightsError
from frida_painter.weights.cache import find
from frida_painter.weights.catalogue import all_weights
from frida_painter.weights.sources import Hub

_WHOLE = "config.json"
_SMALL = ("*.json", "*.txt", "*.model")
_TENSORS = ("*.safetensors", "pytorch_model.bin")  # the second one if there is no file of the first kind
_BY_AUTHORS = {
    "vit-b/32": "openai/clip-vit-base-patch32",
    "vit-b/16": "openai/clip-vit-base-patch16",
    "vit-l/14": "openai/clip-vit-large-patch14",
    "vit-l/14@336px": "openai/clip-vit-large-patch14-336",
}
_NAME = re.compile(r"\w[\w.-]*/\w[\w.-]*")


def hub_folder(name: str, cache: Path | None = None) -> Path:
    """Returns the folder with the files of a network; downloads them if they are nowhere on this machine.

    name: of the catalogue ("clip-vit-b-32"), of the hub ("openai/clip-vit-base-patch32", with or without its owner
    for networks of the catalogue), or of the authors ("ViT-B/32")
    cache: folder of fetched weights; by default the usual one
    Raises WeightsError with the reason alone, without a full stop.
    """
    repository = _BY_AUTHORS.get(name.lower(), name)
    for known in all_weights():
        hubs = [source.repository for source in known.sources if isinstance(source, Hub)]
        names = [known.name, *hubs, *(hub.rpartition("/")[2] for hub in hubs)]
        if hubs and repository.lower() in map(str.lower, names):
            if (folder := find(known.name, cache)) is not None:
                return folder
            repository = hubs[0]
    if not _NAME.fullmatch(repository):
        raise WeightsError("there is no such folder, and a name on the hub is like openai/clip-vit-base-patch32")
    return _kept(repository) or _fetch(repository)


def _kept(repository: str) -> Path | None:
    """Returns the folder of an earlier download; None if there is none, or only half of one."""
    from huggingface_hub import snapshot_download

    try:
        folder = Path(snapshot_download(repository, local_files_only=True))
    except (OSError, ValueError):
        return None
    whole = (folder / _WHOLE).is_file() and any(any(folder.glob(pattern)) for pattern in _TENSORS)
    return folder if whole else None


def _fetch(repository: str) -> Path:
    from huggingface_hub import HfApi, snapshot_download
    from huggingface_hub.errors import HfHubHTTPError

    Hub(repository, "main").require(_WHOLE)  # an unreachable hub costs seconds, not minutes of retries
    endpoint = os.environ.get("HF_ENDPOINT") or None
    try:
        files = HfApi(endpoint=endpoint).list_repo_files(repository)
        tensors = _TENSORS[:1] if any(file.endswith(".safetensors") and "/" not in file for file in files) else _TENSORS
        wanted = [*_SMALL, *tensors]
        return Path(snapshot_download(repository, allow_patterns=wanted, ignore_patterns=["*/*"], endpoint=endpoint))
    except HfHubHTTPError as cause:
        raise WeightsError(f"the hub does not give it ({type(cause).__name__})") from cause
    except (OSError, ValueError) as cause:
        raise WeightsError(f"the download stopped ({' '.join(str(cause).split())[:80]})") from cause
