"""Folder of a network by any of its names: in the catalogue, on the hub of `transformers`, or as its authors call it.

Only settings, vocabulary and tensors are fetched, once; code beside them stays where it is.
"""

import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from frida_painter import python_process
from frida_painter.errors import WeightsError
from frida_painter.storage import exists, in_home, megabytes, read_bytes, require_space
from frida_painter.transfer import TOO_SLOW, Transfer
from frida_painter.weights import hub_process
from frida_painter.weights.cache import find
from frida_painter.weights.catalogue import all_weights
from frida_painter.weights.sources import Hub, run_fetching

_WHOLE = "config.json"
OPEN_CLIP = "open_clip_config.json"
"""Settings of a network in the layout of open_clip."""
_SMALL = ("*.json", "*.txt", "*.model")
_TENSORS = ("*.safetensors", "pytorch_model.bin")  # the second one if there is no file of the first kind
_ONE, _INDEX = "model.safetensors", "model.safetensors.index.json"
_TWICE = "open_clip_"  # beginning of the names of the same network once more
_NEEDED = (  # names for each kind of file, the usual one first
    (_WHOLE,),
    (_ONE, _INDEX, "pytorch_model.bin"),
    ("tokenizer.json", "vocab.json", "spiece.model", "tokenizer.model"),
)
_NEEDED_BY_OPEN_CLIP = (
    (OPEN_CLIP,),
    ("open_clip_model.safetensors", "open_clip_pytorch_model.bin"),
    _NEEDED[-1],
)
_MAX_INDEX = 10**7  # bytes
_BY_AUTHORS = {  # ViT-B/32 is also written ViT-B-32
    "vit-b-32": "openai/clip-vit-base-patch32",
    "vit-b-16": "openai/clip-vit-base-patch16",
    "vit-l-14": "openai/clip-vit-large-patch14",
    "vit-l-14-336": "openai/clip-vit-large-patch14-336",
}
_NAME = re.compile(r"\w[\w.-]*/\w[\w.-]*")
_ADDRESS = re.compile(r"https?://[^/]+/|hf(-hub)?:(//)?")
_VIEW = re.compile("/(tree|blob|resolve)/.*")  # end of the address of a page about a network
_KEPT = "models--"  # beginning of the folders of the hub's cache
_APART = {  # the hub's faster protocol writes nothing for long, so that nobody could tell whether anything comes
    "HF_HUB_DISABLE_XET": "1", "HF_HUB_DISABLE_PROGRESS_BARS": "1", "HF_HUB_DISABLE_TELEMETRY": "1",
    "HF_HUB_VERBOSITY": "error",
}  # fmt: skip


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
    with TemporaryDirectory() as place:
        usual = {next(name for name in needed[1] if name.endswith(ending)): file}
        small = {beside.name: beside for kind in _SMALL for beside in file.parent.glob(kind)}
        for name, kept in (small | usual).items():
            if name not in ((_INDEX, _WHOLE) if of_open_clip else (_INDEX,)):
                (Path(place) / name).symlink_to(kept.absolute())
        yield Path(place)


def tensor_names(file: Path) -> list[str]:
    """Returns the names of the tensors in a safetensors file; none for any other file."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(file, "pt") as tensors:
            return list(tensors.keys())
    except (SafetensorError, OSError):
        return []


def plain_name(name: str) -> str:
    """Returns the name of a network on the hub, without the hub's address, and of a folder of its cache."""
    plain = _VIEW.sub("", _ADDRESS.sub("", name.strip(), count=1)).rstrip("/")
    return plain.removeprefix(_KEPT).replace("--", "/", 1) if plain.startswith(_KEPT) else plain


def hub_folder(
    name: str,
    cache: Path | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
    heed: Callable[[], None] = lambda: None,
) -> Path:
    """Returns the folder with the files of a network; downloads them if they are nowhere on this machine.

    name: of the catalogue ("clip-vit-b-32"), of the hub ("openai/clip-vit-base-patch32", also as an address; with or
    without its owner for networks that were fetched), or of the authors ("ViT-B/32")
    cache: folder of fetched weights; by default the usual one
    tell, heed: as in `fetch_from_hub`
    Raises WeightsError with the reason alone, without a full stop.
    """
    plain = plain_name(name)
    repository = _BY_AUTHORS.get(re.sub("[/@]", "-", plain.lower()).removesuffix("px"), plain)
    for known in all_weights():
        hubs = [source.repository for source in known.sources if isinstance(source, Hub)]
        names = [known.name, *hubs, *(hub.rpartition("/")[2] for hub in hubs)]
        if hubs and repository.lower() in map(str.lower, names):
            if (folder := find(known.name, cache)) is not None:
                return folder
            repository = hubs[0]
    repository = _name_in_cache(repository)
    if not _NAME.fullmatch(repository):
        raise WeightsError("there is no such folder, and a name on the hub is like openai/clip-vit-base-patch32")
    kept = _kept(repository)
    missing = None if kept is None else missing_file(kept)
    if kept is not None and missing is None:
        return kept
    try:
        return _fetch(repository, tell, heed)
    except WeightsError as cause:
        if missing is None:
            raise
        raise WeightsError(f"half of it is here, without {missing}, and {cause}") from cause


def is_of_open_clip(folder: Path) -> bool:
    """Returns True for the folder of a network that is there only in the layout of open_clip."""
    return _is_only_of_open_clip(_names(folder))


def missing_file(folder: Path) -> str | None:
    """Returns the name of a file that the folder of a network lacks; None if it is whole."""
    names = _names(folder)
    only = _is_only_of_open_clip(names)
    if (absent := _absent(names, _NEEDED_BY_OPEN_CLIP if only else _NEEDED)) is not None or only:
        return absent
    if (folder / _ONE).is_file() or not (folder / _INDEX).is_file():
        return None
    try:
        index = json.loads(read_bytes(folder / _INDEX, "the list of a network's files", _MAX_INDEX, WeightsError))
        parts = sorted(set(index["weight_map"].values()))
        return next((part for part in parts if not (folder / part).is_file()), None)
    except (WeightsError, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return _INDEX


def _names(folder: Path) -> list[str]:
    return [file.name for file in folder.iterdir() if file.is_file()]


def _is_only_of_open_clip(names: Collection[str]) -> bool:
    return OPEN_CLIP in names and _absent(names, _NEEDED[:2]) is not None


def _absent(names: Collection[str], needed: Sequence[Sequence[str]]) -> str | None:
    """Returns the usual name of a kind of file that is not among some names; None if all kinds are."""
    return next((kind[0] for kind in needed if not any(name in names for name in kind)), None)


def _newest_snapshot(folder: Path) -> Path | None:
    """Returns the newest network in a folder of the hub's cache; None if there is none."""
    kept = [file for whole in (_WHOLE, OPEN_CLIP) for file in folder.glob(f"snapshots/*/{whole}")]
    return max(kept, key=lambda file: file.stat().st_mtime).parent if kept else None


def _name_in_cache(name: str) -> str:
    """Returns the full name, in its own letters, of the only network of that name in the cache of the hub; else it."""
    from huggingface_hub import constants

    folders = [folder.name for folder in Path(constants.HF_HUB_CACHE).glob(f"{_KEPT}*")]
    names = [folder.removeprefix(_KEPT).replace("--", "/") for folder in folders]
    same = [kept for kept in names if name.lower() in (kept.lower(), kept.lower().rpartition("/")[2])]
    return same[0] if len(same) == 1 else name


def _kept(repository: str) -> Path | None:
    """Returns the folder of an earlier download, whole or half; None if there is none."""
    from huggingface_hub import constants, snapshot_download

    try:
        return Path(snapshot_download(repository, local_files_only=True))
    except (OSError, ValueError):  # a copied folder may lack the note which of its networks is the newest
        return _newest_snapshot(Path(constants.HF_HUB_CACHE) / f"{_KEPT}{repository.replace('/', '--')}")


def _fetch(repository: str, tell: Callable[[str], None], heed: Callable[[], None]) -> Path:
    Hub(repository, "main").require(_WHOLE, OPEN_CLIP)  # an unreachable hub costs seconds, not minutes of retries

    def choose(sizes: Mapping[str, int]) -> list[str]:
        plain = [file for file in sizes if "/" not in file]
        twice = _is_only_of_open_clip(plain)
        if (absent := _absent(plain, _NEEDED_BY_OPEN_CLIP if twice else _NEEDED)) is not None:
            raise WeightsError(f"it has no {absent}")
        small = [file for file in plain if any(fnmatchcase(file, kind) for kind in _SMALL)]
        mine = [file for file in plain if file.startswith(_TWICE) == twice]
        safe, archives = ([file for file in mine if fnmatchcase(file.removeprefix(_TWICE), kind)] for kind in _TENSORS)
        return [file for file in small if twice or file in mine] + (safe or archives)

    return fetch_from_hub(repository, choose, tell, heed)


# Downloads from the hub, by a process whose bytes are counted


def fetch_from_hub(
    repository: str,
    choose: Callable[[Mapping[str, int]], Sequence[str]],
    tell: Callable[[str], None],
    heed: Callable[[], None] = lambda: None,
) -> Path:
    """Fetches files of a repository into the hub's cache, and returns their folder there.

    choose: returns the files to be fetched, from the sizes of all files
    tell: receives sentences about the progress
    heed: called often; may raise to end the download, of which the next one continues what has come
    Raises WeightsError with the reason alone, without a full stop: if the hub does not give them, or hardly anything
    comes for a minute.
    """
    from huggingface_hub import constants, try_to_load_from_cache

    sizes: dict[str, int] = ask_hub("list", repository, heed=heed)
    wanted = choose(sizes)
    if not wanted:
        raise WeightsError("it has no files of a network")
    new = [file for file in wanted if not isinstance(try_to_load_from_cache(repository, file), str)]
    total = sum(sizes[file] for file in new)
    require_space(Path(constants.HF_HUB_CACHE), total, f"{repository} of the hub")
    tell(f"Fetching {repository} from {Hub(repository, 'main').endpoint} once, {megabytes(total)}.")
    return Path(ask_hub("fetch", repository, wanted, Transfer("Fetched", total or None, tell), heed))


def ask_hub(
    what: Literal["list", "fetch"],
    repository: str,
    files: Sequence[str] = (),
    transfer: Transfer | None = None,
    heed: Callable[[], None] = lambda: None,
) -> Any:
    """Returns the sizes of a repository's files by name, or the folder into which `files` were fetched.

    transfer, heed: hear of the progress; see `fetch_from_hub`, which also raises the same
    """
    from huggingface_hub import constants

    cache = Path(constants.HF_HUB_CACHE)
    kept = cache / f"{_KEPT}{repository.replace('/', '--')}"
    before, transfer = _count_bytes(kept), transfer or Transfer()

    def watch() -> None:
        heed()
        if not transfer.hear(_count_bytes(kept) - before):
            raise WeightsError(TOO_SLOW)

    with TemporaryDirectory() as place:
        answer = Path(place) / "answer.json"
        command = python_process.command(hub_process.__file__, what, answer, repository, *files)
        log = run_fetching(command, Path(place), watch, {**_APART, "HF_HUB_CACHE": str(cache)})
        if log is not None:
            lines = [line.strip() for line in log.splitlines() if line.strip()]
            raise WeightsError(f"the hub does not give it: {lines[-1][:160] if lines else 'nobody knows why'}")
        return json.loads(read_bytes(answer, "the answer of the hub", _MAX_INDEX, WeightsError))


def _count_bytes(folder: Path) -> int:
    """Returns the bytes of the files in a folder of the hub's cache, while others write there."""
    count = 0
    for file in folder.glob("blobs/*"):
        try:
            count += file.stat().st_size
        except OSError:
            continue
    return count
