"""Folders of diffusion pipelines: read before anything of them is loaded, and refused if they could run code."""

import json
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from frida_painter import registry
from frida_painter.errors import ConfigError, WeightsError
from frida_painter.objectives.weights.hub_folder import fetch_from_hub, tensor_names
from frida_painter.system import storage

INDEX = "model_index.json"
"""List of a pipeline's parts."""
FEW_STEPS, USUAL_STEPS = 4, 20
_FEW = re.compile("turbo|lcm|lightning|schnell|hyper|tcd|flash", re.IGNORECASE)
_LIBRARIES = ("diffusers", "transformers")
_WEIGHTS = re.compile(r"(?:model|diffusion_pytorch_model)(?:\.(\w+))?(?:-(\d{5})-of-(\d{5}))?\.safetensors")
_PICKLES = (".bin", ".ckpt", ".pt", ".pth", ".pkl", ".pickle")
_SETTINGS = (".json", ".txt", ".model", ".jinja")
_HUB_NAME = re.compile(r"[A-Za-z0-9][\w.-]{0,95}/[A-Za-z0-9][\w.-]{0,95}")
_EXAMPLE = "diffusers:stabilityai/sd-turbo"
_MAX_JSON = 100 * 10**6  # bytes; the tokenizers of large language models have some 20 MB


class HalfDownload(ConfigError):
    """Folder of a pipeline in which files are missing or cut off."""


@dataclass(frozen=True)
class PipelineFolder:
    """Pipeline that may be loaded.

    name: name for messages and the record
    pipeline: class of `diffusers`
    weights: files that are read
    variant: variant of the weights, for example fp16, if some exist in no other
    steps: usual number of steps; few if the name or the scheduler says that the network was made for few
    """

    folder: Path
    name: str
    pipeline: str
    weights: tuple[Path, ...]
    variant: str | None
    steps: int


def find_pipeline(source: str, user: str) -> PipelineFolder | None:
    """Returns the pipeline of a folder, or of a name that was fetched from the hub; None if it has to be fetched.

    user: who wants it, at the beginning of a sentence
    Raises ConfigError if the source is neither, or a pipeline that is refused.
    """
    if not source.strip() or "\0" in source:
        raise ConfigError(
            f"{user} was given no pipeline; fetch one with `frida-painter models fetch {registry.IMAGINE}`, or write "
            f"for example {_EXAMPLE}."
        )
    folder = storage.in_home(source)
    try:
        if folder.is_dir():
            return read_pipeline_folder(folder.resolve(), folder.resolve().name)
        is_file = folder.exists()
    except OSError as cause:
        raise ConfigError(f"{source[:80]} cannot be read ({cause.strerror}); name a folder.") from cause
    if is_file:
        raise ConfigError(f"{source[:80]} is a file; name the folder of a pipeline, or a name on the hub.")
    if not _HUB_NAME.fullmatch(source):
        raise ConfigError(
            f"{source[:80]!r} is neither a folder that is here nor a name on the hub; write for example {_EXAMPLE}."
        )
    from huggingface_hub import try_to_load_from_cache

    index = try_to_load_from_cache(source, INDEX)
    try:
        return read_pipeline_folder(Path(index).parent, source) if isinstance(index, str) else None
    except HalfDownload:
        return None


def fetch_pipeline(name: str, tell: Callable[[str], None], heed: Callable[[], None] = lambda: None) -> PipelineFolder:
    """Fetches a pipeline from the hub into its cache: only settings and safetensors of its parts, and never code.

    tell, heed: as in `fetch_from_hub`
    Raises WeightsError if the hub does not give it, and the errors of `read_pipeline_folder`.
    """
    try:
        index = fetch_from_hub(name, _choose_index, heed=heed) / INDEX
        _, parts = parse_index(read_settings(index, name), name)  # one that wants code is refused before its weights
        folder = fetch_from_hub(name, lambda names: _choose_files(names, parts), tell, heed)
        return read_pipeline_folder(folder, name)
    except WeightsError as cause:
        why = str(cause).rstrip(".")
        raise WeightsError(
            f"{name} cannot be fetched from the hub ({why}); check the name and the network, or give a folder."
        ) from cause


def _choose_index(names: Collection[str]) -> list[str]:
    if INDEX not in names:
        raise WeightsError(f"it has no {INDEX}, so it is no pipeline of diffusers")
    return [INDEX]


def _choose_files(names: Collection[str], parts: Collection[str]) -> list[str]:
    """Returns the settings and weights of the parts; no programs and no pickles."""
    wanted = [INDEX]
    for part in parts:
        files = [name.removeprefix(f"{part}/") for name in names if name.startswith(f"{part}/")]
        settings = [name for name in files if Path(name).suffix in _SETTINGS and "/" not in name]
        wanted += [f"{part}/{name}" for name in (*settings, *choose_weights(files))]
    return wanted


def read_pipeline_folder(folder: Path, name: str) -> PipelineFolder:
    """Reads a pipeline's folder and the headers of its weights; loads nothing.

    Raises HalfDownload if files are missing or cut off, and ConfigError if this is no pipeline, or one that could run
    code: parts of other libraries, code beside the weights, weights in pickles.
    """
    if not (folder / INDEX).is_file():
        error = HalfDownload if any(folder.glob("*/*.safetensors")) else ConfigError
        raise error(f"{name} has no {INDEX}, so it is no pipeline of diffusers; name the folder that has it.")
    index = read_settings(folder / INDEX, name)
    pipeline, parts = parse_index(index, name)
    code = next((path for path in sorted(folder.rglob("*.py")) if path.is_file()), None)
    if code is not None:
        raise _wants_code(name, f"it has the program {code.relative_to(folder)}")
    if any(folder.rglob("*.incomplete")):
        raise _half(name, "a file is marked as incomplete")
    weights = [file for part, kind in parts.items() for file in _read_part(folder / part, kind, name)]
    if not weights:
        raise ConfigError(f"{name} has no weights at all; name a pipeline with networks.")
    variants = sorted({_variant(file.name) for file in weights} - {""})
    if len(variants) > 1:
        raise ConfigError(f"{name} has its weights in the variants {', '.join(variants)}; give all in one.")
    known_as = f"{name} {parts.get('scheduler', '')} {index.get('_name_or_path', '')}"
    steps = FEW_STEPS if _FEW.search(known_as) else USUAL_STEPS
    return PipelineFolder(folder, name, pipeline, tuple(weights), next(iter(variants), None), steps)


def parse_index(index: Mapping[str, Any], name: str) -> tuple[str, dict[str, str]]:
    """Returns the class of a pipeline, and the classes of its parts by name. Raises ConfigError."""
    pipeline = index.get("_class_name")
    if isinstance(pipeline, list):
        raise _wants_code(name, "its pipeline is a class of its own")
    if not isinstance(pipeline, str) or not pipeline.isidentifier():
        raise ConfigError(f"The {INDEX} of {name} names no pipeline; take an undamaged copy.")
    parts: dict[str, str] = {}
    for part, value in index.items():
        if part.startswith("_") or not isinstance(value, list) or value == [None, None]:
            continue
        words = [word for word in value if isinstance(word, str) and word.isidentifier()]
        if not part.isidentifier() or len(words) != 2 or len(value) != 2:
            raise _wants_code(name, f"its part {part[:40]!r} is {str(value)[:80]}")
        library, parts[part] = words
        if library not in _LIBRARIES and not _is_of_diffusers(library):
            raise _wants_code(name, f"its part {part!r} is of the library {library[:40]!r}")
    return pipeline, parts


def choose_weights(names: Collection[str]) -> list[str]:
    """Returns the weights that are read among the names of a part's files: the plain ones, else one variant's."""
    found = [name for name in sorted(names) if _WEIGHTS.fullmatch(name)]
    variants = sorted({_variant(name) for name in found})
    wanted = "fp16" if "fp16" in variants and "" not in variants else next(iter(variants), "")
    return [name for name in found if _variant(name) == wanted]


def _variant(file: str) -> str:
    """Returns the variant of a file of weights, for example fp16; "" for the plain ones."""
    match = _WEIGHTS.fullmatch(file)
    return match[1] or "" if match else ""


def _is_of_diffusers(library: str) -> bool:
    """Returns True for a room of diffusers' own pipelines, as the safety checker of Stable Diffusion has."""
    package = find_spec("diffusers")
    return package is not None and (Path(str(package.origin)).parent / "pipelines" / library).is_dir()


def _read_part(part: Path, kind: str, name: str) -> list[Path]:
    """Returns the weights of a part; none for a part without a network."""
    if not part.is_dir() or not any(part.iterdir()):
        raise _half(name, f"the folder {part.name} is missing or empty")
    for path in part.glob("*.json"):
        if "auto_map" in read_settings(path, name):
            raise _wants_code(name, f"{part.name}/{path.name} names code")
    if any(word in kind for word in ("Scheduler", "Tokenizer", "Processor", "FeatureExtractor")):
        if not any(path.suffix in _SETTINGS and path.is_file() for path in part.iterdir()):
            raise _half(name, f"the settings of {part.name} are missing")
        return []
    if not (part / "config.json").is_file():
        raise _half(name, f"{part.name}/config.json is missing")
    files = [part / file for file in choose_weights([path.name for path in part.iterdir()])]
    if not files:
        if any(path.suffix in _PICKLES for path in part.iterdir()):
            raise ConfigError(
                f"{name} has the weights of {part.name} only as a pickle, which can run code; take "
                "one with safetensors."
            )
        raise _half(name, f"the weights of {part.name} are missing")
    shards = {match[3] for file in files if (match := _WEIGHTS.fullmatch(file.name)) and match[3]}
    if shards and [len(files)] != [int(count) for count in shards]:
        raise _half(name, f"{len(files)} of {max(map(int, shards))} files of {part.name} are here")
    for file in files:
        if not tensor_names(file):  # their header says how long the file is
            raise _half(name, f"{part.name}/{file.name} is cut off")
    return files


def read_settings(path: Path, name: str) -> Mapping[str, Any]:
    """Returns the object in a JSON file; an empty one if it holds something else. Raises HalfDownload."""
    try:
        found = json.loads(storage.read_bytes(path, "the settings of a pipeline", _MAX_JSON, ConfigError))
    except (ValueError, RecursionError) as cause:
        place = path.name if path.name == INDEX else f"{path.parent.name}/{path.name}"
        raise _half(name, f"{place} is cut off or not JSON") from cause
    return found if isinstance(found, dict) else {}


def _half(name: str, why: str) -> HalfDownload:
    return HalfDownload(f"{name} is half a download or damaged ({why}); fetch it again.")


def _wants_code(name: str, why: str) -> ConfigError:
    return ConfigError(f"{name} wants code of its own to be run ({why}), which is refused; name a pipeline without.")
