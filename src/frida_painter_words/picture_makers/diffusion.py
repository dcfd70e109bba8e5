"""Picture maker `diffusers`: a pipeline in a folder or of the hub, run in a process of its own."""

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from frida_painter import python_process, registry, storage
from frida_painter.errors import ConfigError, MakingFailed, WeightsError
from frida_painter.weights.catalogue import find_weights
from frida_painter.weights.pipeline_folder import (
    USUAL_STEPS,
    PipelineFolder,
    fetch_pipeline,
    find_pipeline,
    read_pipeline_folder,
)
from frida_painter_words.picture_makers.command import run_program
from frida_painter_words.picture_makers.making import STRENGTH, PictureMakerKind, PictureRequest

TASK, ANSWER, FAULT = "task.json", "answer.json", "fault"
"""Files in the folder of a task: the task, the answer, and the sentence for the person if there is no answer."""
TOLD = "frida-painter: "
"""Beginning of the lines of the standard error that are told to the person."""
_STEPS = re.compile(r"(.*),\s*steps=(\d{1,4})")
_MAX_STEPS = 200
_OFFLINE = {"HF_HUB_OFFLINE": "1", "TRANSFORMERS_OFFLINE": "1", "HF_HUB_DISABLE_TELEMETRY": "1"}


@dataclass(frozen=True)
class DiffusionMaker:
    """Pipeline of diffusers.

    source: name on the hub, or folder
    here: the pipeline; None if it has to be fetched
    steps: number of steps. None: the usual one of the pipeline
    facts: name, class, steps and the hashes of the weights
    """

    source: str
    here: PipelineFolder | None
    steps: int | None = None
    facts: dict[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, text: str) -> "DiffusionMaker":
        """Returns the maker of a folder or name, with ",steps=N" if wanted; loads and fetches nothing.

        Raises ConfigError if it is neither, or a pipeline that is refused.
        """
        registry.require("imagine", "diffusers", "The picture maker diffusers")
        registry.require("imagine", "transformers", "The picture maker diffusers")
        match = _STEPS.fullmatch(text)
        source, steps = (match[1], int(match[2])) if match else (text, None)
        if steps is not None and not 1 <= steps <= _MAX_STEPS:
            raise ConfigError(f"{steps} steps were asked for; a pipeline takes 1 to {_MAX_STEPS}.")
        if not source and registry.are_here(registry.IMAGINE):
            return cls(registry.IMAGINE, _fetched(), steps)
        return cls(source, find_pipeline(source, "The picture maker diffusers"), steps)

    def make(self, request: PictureRequest) -> Sequence[Path | MakingFailed]:
        """Returns a picture file for each seed, or a reason. Raises MakingFailed, ConfigError and Interrupted."""
        until = time.monotonic() + request.seconds
        try:
            heed = partial(request.heed, "The download", until)
            pipeline = self.here or fetch_pipeline(self.source, request.tell, heed)
        except (WeightsError, ConfigError) as cause:
            raise MakingFailed(str(cause)) from cause
        steps = self.steps or pipeline.steps
        task = {
            "name": pipeline.name, "folder": str(pipeline.folder), "pipeline": pipeline.pipeline,
            "variant": pipeline.variant, "weights": [str(file) for file in pipeline.weights], "steps": steps,
            "record": str(pipeline.folder / registry.RECORD) if pipeline.folder == _fetched_folder() else None,
            "few": pipeline.steps < USUAL_STEPS, "words": request.words, "seeds": list(request.seeds),
            "width": request.width, "height": request.height, "device": str(request.device),
            "canvas": str(request.canvas or ""), "free": str(request.free or ""), "strength": STRENGTH,
        }  # fmt: skip
        folder = request.folder / "pipeline"
        missing = MakingFailed("The pipeline was ended before this picture.")
        try:
            answer = run_pipeline(task, folder, request, until)
        except MakingFailed as fault:
            if not (folder / ANSWER).is_file():
                raise
            answer, missing = storage.read_json(folder / ANSWER, "the answer of a picture maker", MakingFailed), fault
        self.facts.update(
            model=pipeline.name, pipeline=answer["pipeline"], steps=f"{steps} steps", size=str(answer["size"]),
            sha256=" ".join(answer["hashes"]),
        )  # fmt: skip
        made = [
            folder / Path(one["file"]).name if "file" in one else MakingFailed(one["fault"]) for one in answer["made"]
        ]
        return [*made, *[missing] * (len(request.seeds) - len(made))]


def run_pipeline(task: Mapping[str, Any], folder: Path, request: PictureRequest, until: float) -> dict[str, Any]:
    """Runs a pipeline in a process of its own, and returns its answer.

    task: as in pipeline_process.py
    folder: new folder for the task and its files
    request: the pictures that were asked for; receives what the process tells, and may be stopped
    until: time of the monotonic clock at which it is ended
    Raises MakingFailed, with the process's own sentence if there is one, and Interrupted.
    """
    folder.mkdir()
    storage.write_json(folder / TASK, task)
    try:
        run_program(
            python_process.command("-m", "frida_painter_words.picture_makers.pipeline_process", folder), "The pipeline",
            request, folder, until,
            hear=lambda line: request.tell(line.removeprefix(TOLD)) if line.startswith(TOLD) else None,
            environment=python_process.environment(**_OFFLINE),
        )  # fmt: skip
    except MakingFailed as end:
        fault = folder / FAULT
        if fault.is_file():
            raise MakingFailed(storage.read_bytes(fault, "a sentence of the pipeline", 10**6).decode()) from end
        raise
    return storage.read_json(folder / ANSWER, "the answer of a picture maker", MakingFailed)


def _fetched_folder() -> Path:
    return (registry.cache_folder() / registry.IMAGINE).resolve()


def _fetched() -> PipelineFolder:
    """Returns the pipeline that `models fetch imagine` got; the process that loads it checks its hashes."""
    (hub,) = find_weights(registry.IMAGINE).sources
    try:
        return read_pipeline_folder(_fetched_folder(), hub.removeprefix("hub:").partition("@")[0])
    except ConfigError as cause:
        raise ConfigError(
            f"The fetched generator is damaged ({str(cause).rstrip('.')}); `frida-painter models fetch "
            f"{registry.IMAGINE}` mends it."
        ) from cause


DIFFUSERS = PictureMakerKind(
    "diffusers",
    "A pipeline of diffusers: a folder, or a name on the hub, which is fetched once; FOLDER,steps=N sets the steps. "
    f"Without a folder: that of `models fetch {registry.IMAGINE}`.",
    DiffusionMaker.parse,
    lambda text: True,
)
