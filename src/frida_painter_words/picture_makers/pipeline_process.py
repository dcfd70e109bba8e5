"""Diffusion pipeline in a process of its own: it makes pictures, and gives its memory back by ending."""

import inspect
import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from frida_painter.errors import MakingFailed
from frida_painter.objectives.weights.pipeline_folder import USUAL_STEPS, PipelineFolder
from frida_painter.registry import IMAGINE
from frida_painter.system import images, storage
from frida_painter.system.python_process import ProcessLimits, in_own_process
from frida_painter_words.picture_makers.making import MAX_BYTES, STRENGTH

_STEP = 64  # pixels; sizes are multiples of it; for small networks, of an eighth of their usual size
_BLACK = 1 / 255
_MANY_TOKENS, _USUAL_TOKENS = 10**6, 77
_OF_A_PICTURE = {"mask_image", "strength", "image_guidance_scale"}
"""Arguments that only pipelines have that begin from a picture."""


@dataclass(frozen=True)
class PipelineTask:
    """Pictures that a pipeline shall make.

    pipeline: what makes them, in that many steps
    hashes: file of the hashes that its weights must have; None if there is none
    words, seeds, width, height, canvas, free: as in PictureRequest
    device: name of the device
    pictures: folder for the files 1.png, 2.png, ...
    """

    pipeline: PipelineFolder
    steps: int
    hashes: Path | None
    words: str
    seeds: tuple[int, ...]
    width: int
    height: int
    device: str
    canvas: Path | None
    free: Path | None
    pictures: Path


@dataclass(frozen=True)
class PipelineAnswer:
    """Pictures of a pipeline so far.

    size, pipeline, hashes: size of the pictures, class that ran, and hashes of its weights
    faults: for each picture, why it cannot be used; "" if it can
    """

    size: str
    pipeline: str
    hashes: tuple[str, ...]
    faults: tuple[str, ...] = ()


@in_own_process(
    ProcessLimits(written=MAX_BYTES), HF_HUB_OFFLINE="1", TRANSFORMERS_OFFLINE="1", HF_HUB_DISABLE_TELEMETRY="1"
)
def make_pictures(task: PipelineTask, tell: Callable[[str], None], keep: Callable[[PipelineAnswer], None]) -> None:
    """Makes the pictures of a task. Raises MakingFailed.

    tell: receives sentences about the progress
    keep: receives the answer after each picture, so that those before an end stay
    """
    name, device = task.pipeline.name, torch.device(task.device)
    tell(f"Reading {name}.")
    hashes = [storage.sha256(file, "the weights of a pipeline", MakingFailed) for file in task.pipeline.weights]
    if task.hashes is not None:
        known = storage.read_json(task.hashes, "the record of fetched weights", MakingFailed).get("files", {})
        for file, sha256 in zip(task.pipeline.weights, hashes, strict=True):
            if known.get(file.relative_to(task.pipeline.folder).as_posix()) != sha256:
                raise MakingFailed(
                    f"{name} was altered after it was fetched ({file.parent.name}/{file.name}); "
                    f"`frida-painter models fetch {IMAGINE}` mends it."
                )
    pipeline = _load(task, device, tell)
    width, height = _size(pipeline, task.width, task.height)
    arguments = inspect.signature(pipeline.__call__).parameters
    begins_from: dict[str, Any] = {}
    if task.canvas:
        seen = images.load_exactly(task.canvas)
        free = images.load_exactly(task.free) if task.free else np.full_like(seen, 255)
        canvas, mask = (Image.fromarray(each).resize((width, height), Image.Resampling.BOX) for each in (seen, free))
        begins_from = {"image": canvas, "mask_image": mask.convert("L"), "strength": STRENGTH}
        begins_from = {name: value for name, value in begins_from.items() if name in arguments}
    # Of these steps, an img2img pipeline does the share that is its strength.
    steps = math.ceil(task.steps / begins_from.get("strength", 1.0))
    faults: list[str] = []
    for number, seed in enumerate(task.seeds, 1):
        given = {
            "prompt": task.words, "width": width, "height": height, "num_inference_steps": steps, **begins_from,
            "generator": torch.Generator().manual_seed(seed), "output_type": "np",
            "callback_on_step_end": _follow(f"Picture {number} of {len(task.seeds)}", task.steps, tell),
            **({"guidance_scale": 0.0} if task.pipeline.steps < USUAL_STEPS and not _knows_guidance(pipeline) else {}),
        }  # fmt: skip
        made = pipeline(**{key: value for key, value in given.items() if key in arguments})
        try:
            picture = _require_picture(made, name, number, width, height)
            images.save(picture, task.pictures / f"{number}.png")
            if _is_censored(made):
                tell(f"The safety checker of {name} made picture {number} black; try another --seed or other words.")
            faults.append("")
        except MakingFailed as fault:
            faults.append(str(fault))
        keep(PipelineAnswer(f"{width} x {height}", type(pipeline).__name__, tuple(hashes), tuple(faults)))


def _load(task: PipelineTask, device: torch.device, tell: Callable[[str], None]) -> Any:
    """Returns the pipeline on its device."""
    import diffusers
    from diffusers.utils import logging

    name, kind = task.pipeline.name, task.pipeline.pipeline
    if kind not in dir(diffusers):
        raise MakingFailed(
            f"{name} is a {kind}, which diffusers {diffusers.__version__} does not have; install a newer one, or name "
            "another pipeline."
        )
    asked = inspect.signature(getattr(diffusers, kind).__call__).parameters
    if "prompt" not in asked or (not task.canvas and _OF_A_PICTURE & set(asked)):
        raise MakingFailed(f"{name} is a {kind}, which makes no picture from words alone; name one that does.")
    logging.set_verbosity_error()
    logging.disable_progress_bar()
    tell(f"Loading {name} on {device.type}.")
    _require_whole(name)
    loader: Any = diffusers.DiffusionPipeline
    precision = torch.float32
    if device.type == "cuda":
        precision = torch.bfloat16 if torch.cuda.is_bf16_supported(including_emulation=False) else torch.float16
    try:
        pipeline = loader.from_pretrained(
            task.pipeline.folder, variant=task.pipeline.variant, torch_dtype=precision, use_safetensors=True,
            local_files_only=True, low_cpu_mem_usage=False,
        ).to(device)  # fmt: skip
    except torch.OutOfMemoryError as cause:
        raise MakingFailed(f"{name} does not fit into the memory of the GPU; name a smaller one.") from cause
    if task.canvas and "image" not in asked:
        pipeline = _for_canvas(pipeline, name, masked=bool(task.free))
    pipeline.set_progress_bar_config(disable=True)
    for part, tokenizer in pipeline.components.items():
        if getattr(tokenizer, "model_max_length", 0) > _MANY_TOKENS:  # its settings do not tell: no number holds it
            encoder = getattr(pipeline, part.replace("tokenizer", "text_encoder"), None)
            most = getattr(getattr(encoder, "config", None), "max_position_embeddings", _USUAL_TOKENS)
            tokenizer.model_max_length = min(int(most), _USUAL_TOKENS)
    return pipeline


def _for_canvas(pipeline: Any, name: str, *, masked: bool) -> Any:
    """Returns the pipeline of the same networks that begins from a picture, and keeps what is masked if it can.

    Raises MakingFailed if diffusers has none for these networks.
    """
    from diffusers import AutoPipelineForImage2Image, AutoPipelineForInpainting

    kinds: tuple[Any, ...] = (AutoPipelineForInpainting,) if masked else ()
    for kind in (*kinds, AutoPipelineForImage2Image):
        with suppress(ValueError):  # it has no such pipeline for them
            return kind.from_pipe(pipeline)
    raise MakingFailed(
        f"{name} is a {type(pipeline).__name__}, which makes no picture from the canvas; name one of Stable Diffusion, "
        "or one that edits pictures."
    )


def _require_whole(name: str) -> None:
    """Lets this process load no networks that lack tensors: their libraries fill them by chance, and only log it.

    A pipeline cannot ask its networks what is missing, so the methods that load them are replaced.
    """
    from diffusers import ModelMixin
    from transformers import PreTrainedModel

    def load_whole(load: Callable[..., Any], kind: Any, folder: str, /, **more: Any) -> Any:
        network, told = load(kind, folder, output_loading_info=True, **more)
        if missing := len(told["missing_keys"]):
            raise MakingFailed(
                f"{name} lacks {missing} of the {len(network.state_dict())} tensors of its {Path(folder).name}; take "
                "an undamaged copy, or name another pipeline."
            )
        return network

    networks: tuple[Any, ...] = (ModelMixin, PreTrainedModel)
    for network in networks:
        network.from_pretrained = classmethod(partial(load_whole, network.from_pretrained.__func__))


def _config(pipeline: Any) -> Any:
    """Returns the settings of the network that makes the pictures."""
    return getattr(getattr(pipeline, "unet", None) or getattr(pipeline, "transformer", None), "config", None)


def _size(pipeline: Any, width: int, height: int) -> tuple[int, int]:
    """Returns the wanted proportions in the number of pixels that the network was made for."""
    cells, scale = getattr(_config(pipeline), "sample_size", None), pipeline.__dict__.get("vae_scale_factor")
    if not isinstance(cells, int) or not isinstance(scale, int):
        return width, height
    step = scale * max(1, min(cells // 8, _STEP // scale))
    larger = cells * scale / (width * height) ** 0.5
    return step * max(1, round(width * larger / step)), step * max(1, round(height * larger / step))


def _knows_guidance(pipeline: Any) -> bool:
    """Returns True for a network that was given the guidance as an input (LCM, Flux): its own default is right."""
    config = _config(pipeline)
    return getattr(config, "time_cond_proj_dim", None) is not None or bool(getattr(config, "guidance_embeds", False))


def _follow(label: str, steps: int, tell: Callable[[str], None]) -> Callable[..., dict[str, Any]]:
    """Returns the callback that tells the steps of one picture, with the time that is left."""
    began = time.monotonic()

    def hear(pipeline: Any, step: int, timestep: Any, arguments: dict[str, Any]) -> dict[str, Any]:
        count = max(steps, getattr(pipeline, "_num_timesteps", 0) or 0)
        left = (time.monotonic() - began) / (step + 1) * (count - step - 1)
        more = f", about {left:.0f} s left" if left >= 1 else ""
        tell(f"{label}: step {step + 1} of {count}{more}.")
        return arguments

    return hear


def _require_picture(made: Any, name: str, number: int, width: int, height: int) -> torch.Tensor:
    """Returns the only picture that the pipeline made, [3, H, W]. Raises MakingFailed if it is none."""
    pictures = getattr(made, "images", None)
    if pictures is None:
        raise MakingFailed(f"{name} returned a {type(made).__name__} without pictures; name one that makes pictures.")
    if len(pictures) != 1:
        raise MakingFailed(f"{name} returned {storage.count_of(len(pictures), 'picture')} for one seed; it makes one.")
    values = torch.as_tensor(pictures[0])
    if tuple(values.shape) != (height, width, 3):
        raise MakingFailed(
            f"{name} returned a picture of the shape {tuple(values.shape)} where {(height, width, 3)} was asked for; "
            "name another."
        )
    if not bool(torch.isfinite(values).all()):
        raise MakingFailed(f"Picture {number} of {name} holds values that are no numbers (NaN); name another.")
    return values.permute(2, 0, 1).to(torch.float32).clamp(0, 1)


def _is_censored(made: Any) -> bool:
    """Returns True if the safety checker of a pipeline made its picture black."""
    flagged = getattr(made, "nsfw_content_detected", None)
    return bool(flagged and flagged[0]) and float(torch.as_tensor(made.images[0]).max()) <= _BLACK
