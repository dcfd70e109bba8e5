"""Picture maker `diffusers`: a pipeline in a folder or of the hub, run in a process of its own."""

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from frida_painter import registry
from frida_painter.errors import ConfigError, FridaError, Interrupted, MakingFailed, ProcessLost, WeightsError
from frida_painter.objectives.weights.catalogue import find_weights
from frida_painter.objectives.weights.pipeline_folder import (
    PipelineFolder,
    fetch_pipeline,
    find_pipeline,
    read_pipeline_folder,
)
from frida_painter_words.picture_makers.making import PictureMakerKind, PictureRequest
from frida_painter_words.picture_makers.pipeline_process import PipelineAnswer, PipelineTask, make_pictures

_STEPS = re.compile(r"(.*),\s*steps=(\d{1,4})")
_MAX_STEPS = 200


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
        task = PipelineTask(
            pipeline, steps, pipeline.folder / registry.RECORD if pipeline.folder == _fetched_folder() else None,
            request.words, tuple(request.seeds), request.width, request.height, str(request.device), request.canvas,
            request.free, request.folder / "pipeline",
        )  # fmt: skip
        task.pictures.mkdir()
        answers: list[PipelineAnswer] = []
        missing = MakingFailed("The pipeline was ended before this picture.")
        try:
            make = replace(make_pictures, heed=partial(request.heed, "The pipeline", until))
            make(task, request.tell, answers.append)
        except Interrupted:
            raise
        except FridaError as fault:
            told = f"The pipeline failed ({str(fault).rstrip('.')}); name another, or try it without frida-painter."
            missing = MakingFailed(told if isinstance(fault, ProcessLost) else str(fault))
            if not answers:
                raise missing from fault
        answer = answers[-1]
        self.facts.update(
            model=pipeline.name, pipeline=answer.pipeline, steps=f"{steps} steps", size=answer.size,
            sha256=" ".join(answer.hashes),
        )  # fmt: skip
        made = [
            MakingFailed(fault) if fault else task.pictures / f"{number}.png"
            for number, fault in enumerate(answer.faults, 1)
        ]
        return [*made, *[missing] * (len(request.seeds) - len(made))]


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
