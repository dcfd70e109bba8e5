"""Folder of a network by any of its names: in the catalogue, on the hub of `transformers`, or as its authors call it.

Only settings, vocabulary and tensors are fetched, once; code beside them stays where it is.
"""

import json
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory

from frida_painter.errors import WeightsError
from frida_painter.objectives.weights.cache import find
from frida_painter.objectives.weights.catalogue import NETWORK, all_weights
from frida_painter.objectives.weights.sources import count_in_folder, hub_endpoint, list_files, run_program
from frida_painter.system import python_process
from frida_painter.system.storage import exists, in_home, megabytes, read_bytes, require_space
from frida_painter.system.transfer import Transfer

OPEN_CLIP = "open_clip_config.json"
"""Settings of a network in the layout of open_clip."""
_TWICE = "open_clip_"  # beginning of the names of the same network once more
_TOKENS = ("tokenizer.json", "vocab.json", "spiece.model", "tokenizer.model")
_NEEDED = (("config.json",), (NETWORK, f"{NETWORK}.index.json", "pytorch_model.bin"), _TOKENS)
_NEEDED_BY_OPEN_CLIP = ((OPEN_CLIP,), (f"{_TWICE}{NETWORK}", f"{_TWICE}pytorch_model.bin"), _TOKENS)
"""Names for each kind of file, the usual one first."""
_SMALL, _TENSORS = ("*.json", "*.txt", "*.model"), ("*.safetensors", "pytorch_model.bin")
_MAX_INDEX = 10**7  # bytes
_BY_AUTHORS = {  # ViT-B/32 is also written ViT-B-32
    "vit-b-32": "openai/clip-vit-base-patch32",
    "vit-b-16": "openai/clip-vit-base-patch16",
    "vit-l-14": "openai/clip-vit-large-patch14",
    "vit-l-14-336": "openai/clip-vit-large-patch14-336",
}
_NAME = re.compile(r"\w[\w.-]*/\w[\w.-]*")
_AROUND = re.compile(r"^(https?://[^/]+/|hf(-hub)?:(//)?|models--)|/(tree|blob|resolve)/.*$|/$")  # of an address


def local_folder(name: str) -> Path | None:
    """Returns the folder of that path, in the layout of the hub's cache its newest network; None if there is none."""
    folder = in_home(name)
    if not name.strip() or not exists(folder) or not folder.is_dir():
        return None
    return _newest_snapshot(folder) or folder


@contextmanager
def folder_of_file(file: Path) -> Iterator[Path]:
    """Yields a folder with a file of weights under its usual name, and with the settings and the tokenizer beside it.

    The folder holds links, and is removed afterwards. The names of the tensors tell if the file has the layout of
    open_clip. Raises WeightsError with the reason alone.
    """
    ending = ".safetensors" if file.suffix == ".safetensors" else ".bin"
    of_open_clip = file.name.startswith(_TWICE) or any(name.startswith("visual.") for name in tensor_names(file))
    needed = _NEEDED_BY_OPEN_CLIP if of_open_clip else _NEEDED
    if (absent := _absent(_names(file.parent), (needed[0], needed[2]))) is not None:
        raise WeightsError(f"no {absent} lies beside it")
    left_out = {f"{NETWORK}.index.json", "config.json" if of_open_clip else ""}
    links = {beside.name: beside for kind in _SMALL for beside in file.parent.glob(kind) if beside.name not in left_out}
    links[next(name for name in needed[1] if name.endswith(ending))] = file
    with TemporaryDirectory() as place:
        for name, kept in links.items():
            (Path(place) / name).symlink_to(kept.absolute())
        yield Path(place)


def tensor_names(file: Path) -> list[str]:
    """Returns the names of the tensors in a whole safetensors file; none for any other file."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(file, "pt") as tensors:
            return list(tensors.keys())
    except (SafetensorError, OSError):
        return []


def plain_name(name: str) -> str:
    """Returns the name of a network on the hub, without the hub's address, and of a folder of its cache."""
    plain = _AROUND.sub("", name.strip())
    return plain.replace("--", "/", 1) if name.strip().startswith("models--") else plain


def hub_folder(
    name: str,
    cache: Path | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> Path:
    """Returns the folder with the files of a network; downloads them if they are nowhere on this machine.

    name: of the catalogue ("clip-vit-b-32"), of the hub ("openai/clip-vit-base-patch32", also as an address), or of
    the authors ("ViT-B/32")
    cache: folder of fetched weights; by default the usual one
    tell, heed: as in `fetch_from_hub`
    Raises WeightsError with the reason alone, without a full stop.
    """
    plain = plain_name(name)
    repository = _BY_AUTHORS.get(re.sub("[/@]", "-", plain.lower()).removesuffix("px"), plain)
    for known in all_weights():
        hubs = [each[4:].partition("@")[0] for each in known.sources if each.startswith("hub:")]
        if hubs and repository.lower() in (known.name, *map(str.lower, (hubs[0], hubs[0].rpartition("/")[2]))):
            if (folder := find(known.name, cache)) is not None:
                return folder
            repository = hubs[0]
    if not _NAME.fullmatch(repository):
        raise WeightsError("there is no such folder, and a name on the hub is like openai/clip-vit-base-patch32")
    kept = _newest_snapshot(_folder_in_cache(repository))
    if kept is not None and missing_file(kept) is None:
        return kept
    return fetch_from_hub(repository, _choose_files, tell, heed)


def is_of_open_clip(folder: Path) -> bool:
    """Returns True for the folder of a network that is there only in the layout of open_clip."""
    return _is_only_of_open_clip(_names(folder))


def missing_file(folder: Path) -> str | None:
    """Returns the name of a file that the folder of a network lacks; None if it is whole."""
    names = _names(folder)
    only = _is_only_of_open_clip(names)
    if (absent := _absent(names, _NEEDED_BY_OPEN_CLIP if only else _NEEDED)) is not None or only or NETWORK in names:
        return absent
    index = folder / f"{NETWORK}.index.json"
    try:
        content = read_bytes(index, "the list of a network's files", _MAX_INDEX, WeightsError)
        return next((part for part in sorted({*json.loads(content)["weight_map"].values()}) if part not in names), None)
    except (WeightsError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return index.name if index.exists() else None


def fetch_from_hub(
    repository: str,
    choose: Callable[[Collection[str]], Sequence[str]],
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> Path:
    """Fetches files of a repository into the hub's cache, by the hub's own program; returns their folder there.

    choose: returns the files to be fetched, from the names of all files but those that look like an option
    tell: receives sentences about the progress
    heed: called often; may raise to end the download, of which the next one continues what has come
    Raises WeightsError with the reason alone, without a full stop.
    """
    sizes = {file.path: file.size for file in list_files(f"hub:{repository}@main") if file.path[:1] != "-"}
    wanted, kept = choose(sizes), _folder_in_cache(repository)
    total, before = sum(sizes[file] for file in wanted), count_in_folder(kept)
    require_space(kept, total, f"{repository} of the hub")
    tell(f"Fetching {repository} from {hub_endpoint()} once, {megabytes(total)}.")
    transfer = Transfer("Fetched", total or None, tell)

    def watch() -> None:
        heed()
        transfer.hear(count_in_folder(kept) - before)

    command = python_process.command("-m", "huggingface_hub.cli.hf", "download", repository, *wanted, "-q")
    quiet = {"HF_HUB_DISABLE_PROGRESS_BARS": "1", "HF_HUB_DISABLE_TELEMETRY": "1", "HF_HUB_CACHE": str(kept.parent)}
    with TemporaryDirectory() as place:
        succeeded, said = run_program(command, Path(place), watch, **quiet)
    lines = said.splitlines() or ["nobody knows why"]
    places = [Path(line) for line in lines if line.startswith(str(kept))]  # of the only file, or of the folder of all
    if not succeeded or not places:
        raise WeightsError(f"the hub does not give it: {lines[-1][:160]}")
    return places[-1] if places[-1].is_dir() else places[-1].parent


def _choose_files(names: Collection[str]) -> list[str]:
    """Returns the settings and tensors of a network. Raises WeightsError if it lacks some."""
    plain = [file for file in names if "/" not in file]
    twice = _is_only_of_open_clip(plain)
    if (absent := _absent(plain, _NEEDED_BY_OPEN_CLIP if twice else _NEEDED)) is not None:
        raise WeightsError(f"it has no {absent}")
    mine = [file for file in plain if file.startswith(_TWICE) == twice]
    small = [file for file in (plain if twice else mine) if any(fnmatchcase(file, kind) for kind in _SMALL)]
    safe, archives = ([file for file in mine if fnmatchcase(file.removeprefix(_TWICE), kind)] for kind in _TENSORS)
    return small + (safe or archives)


def _names(folder: Path) -> list[str]:
    return [file.name for file in folder.iterdir() if file.is_file()]


def _is_only_of_open_clip(names: Collection[str]) -> bool:
    return OPEN_CLIP in names and _absent(names, _NEEDED[:2]) is not None


def _absent(names: Collection[str], needed: Sequence[Sequence[str]]) -> str | None:
    """Returns the usual name of a kind of file that is not among some names; None if all kinds are."""
    return next((kind[0] for kind in needed if not any(name in names for name in kind)), None)


def _folder_in_cache(repository: str) -> Path:
    """Returns the folder of a repository in the hub's cache; it need not exist."""
    from huggingface_hub import constants

    return Path(constants.HF_HUB_CACHE) / f"models--{repository.replace('/', '--')}"


def _newest_snapshot(folder: Path) -> Path | None:
    """Returns the newest network in a folder of the hub's cache; None if there is none."""
    kept = [file for name in ("config.json", OPEN_CLIP) for file in folder.glob(f"snapshots/*/{name}")]
    return max(kept, key=lambda file: file.stat().st_mtime).parent if kept else None
