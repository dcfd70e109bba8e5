"""Guidance by diffusion: a network that takes noise out of pictures says how a picture would look more like the words.

Score distillation: Poole et al., "DreamFusion", 2022; for strokes Jain et al., "VectorFusion", 2022, and Xing et al.,
"DiffSketcher", 2023. Timesteps that fall during the work: Huang et al., "DreamTime", 2023. Judging by the error of the
noise: Li et al., "Your Diffusion Model is Secretly a Zero-Shot Classifier", 2023.
"""

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import torch
from torch import Tensor
from torch.nn import functional

from frida_painter import registry
from frida_painter.devices import send_to_device
from frida_painter.errors import ConfigError
from frida_painter.objectives.encoders.loading import Choice
from frida_painter.objectives.objective import Goal, ObjectiveContext, ObjectiveTerm, Term, require_weight
from frida_painter.objectives.word_settings import USUAL, WordSettings
from frida_painter.weights.pipeline_folder import PipelineFolder, fetch_pipeline, find_pipeline

if TYPE_CHECKING:
    from frida_painter.objectives.encoders.latent_diffusion import LatentDiffusion, Words

_SOURCE = re.compile(r"diffusers:(.*?)(?:,\s*scale=(.*))?")
_EXAMPLE = "diffusers:stable-diffusion-v1-5/stable-diffusion-v1-5"
_USUAL_SCALE, _MAX_SCALE = 100.0, 1000.0
_MIN_NOISE, _MAX_NOISE, _MAX_AT_END = 0.02, 0.98, 0.5  # as shares of the timesteps
_CLOSEST = 0.85  # share of the picture's sides in the tightest crop
_JUDGED = (0.35, 0.65)  # timesteps of the validation, which takes about as long as one gradient
_BETWEEN_JUDGEMENTS = 20  # iterations
_LASTS, _LASTS_ON_CUDA = 10, 2  # iterations for which one gradient serves
_APART = 15_485_863  # added to the seed of the validation's noise


@dataclass(frozen=True)
class GuideSource:
    """Pipeline that guides, checked but not loaded.

    name: folder, or name on the hub
    scale: strength of the words against the picture's likeliness without words
    here: None if it has to be fetched
    """

    name: str
    scale: float
    here: PipelineFolder | None = field(default=None, compare=False)

    @classmethod
    def parse(cls, text: str) -> "GuideSource":
        """Returns the source of "diffusers:NAME" or "diffusers:NAME,scale=X"; fetches nothing. Raises ConfigError."""
        match = _SOURCE.fullmatch(text)
        if match is None:
            raise ConfigError(f"{text[:80]!r} cannot guide: it begins with diffusers:, like {_EXAMPLE}.")
        try:
            scale = _USUAL_SCALE if match[2] is None else float(match[2])
        except ValueError:
            scale = math.nan
        if not 1 <= scale <= _MAX_SCALE:
            raise ConfigError(f"A guidance scale of {match[2][:20]!r} was given; it is from 1 to {_MAX_SCALE:g}.")
        for package in ("diffusers", "transformers"):
            registry.require("imagine", package, "Guidance by diffusion")
        return cls(match[1], scale, find_pipeline(match[1], "Guidance by diffusion"))


@dataclass(frozen=True)
class GuidanceTerm(Term):
    """Term for words that a diffusion pipeline follows, beside a CLIP or in its place."""

    prompt: str
    source: GuideSource
    weight: float = 1.0
    settings: WordSettings = USUAL
    interpretation_order = 1  # before the words themselves
    is_tried = False

    def __post_init__(self) -> None:
        require_weight(self.weight, "guided words")

    def say(self, settings: WordSettings) -> "GuidanceTerm":
        """Returns the term with these settings of its words."""
        return replace(self, settings=settings)

    @classmethod
    def interpret(cls, goal: Goal, context: ObjectiveContext) -> Goal:
        """Returns the goal without the words if nothing else reads them, or shall; the guide still follows them."""
        bare = any(isinstance(term, cls) and term.settings.beginning == "nothing" for term in goal.terms)
        if context.encoders.reads_by_clip or (context.encoders.composes and not bare):
            return goal
        return replace(goal, terms=tuple(term for term in goal.terms if term.words is None))

    def prepare(self, context: ObjectiveContext) -> ObjectiveTerm:
        """Returns the objective; one for all grids of a plan, because the network sees them at one size.

        Tells what a step and a plan take. Raises ConfigError and WeightsError if the pipeline cannot be used.
        """
        from frida_painter.objectives.encoders.latent_diffusion import LatentDiffusion

        encoders, source = context.encoders, self.source
        lasts = _LASTS_ON_CUDA if encoders.device.type == "cuda" else _LASTS

        def load() -> "LatentDiffusion":
            here = source.here or fetch_pipeline(source.name, encoders.tell, encoders.heed)
            network = LatentDiffusion.load(here, encoders.device, encoders.tell)
            used = f"{network.name}, by score distillation at scale {source.scale:g}"
            encoders.choices.append(Choice("words", used, hashes=network.hashes))
            return network

        def measure() -> "tuple[list[Words], float]":
            words = network.read([self.prompt, self.settings.avoid])
            seconds = Guidance(network, words, source.scale, 0, 1).measure(context.grid.rows, context.grid.columns)
            encoders.tell(f"A step of {network.name} takes about {seconds:.2g} s on {encoders.device.type}.")
            return words, seconds

        network = encoders.keep(f"guide {source.name}", load)
        name = f"guide {source.name} {source.scale} {self.prompt} {self.settings}"
        words, seconds = encoders.keep(name, measure)
        calls = max(1, context.iterations // lasts)
        guide = context.shared.setdefault(name, Guidance(network, words, source.scale, context.seed, calls))
        took = seconds * (1 + lasts / _BETWEEN_JUDGEMENTS)
        return ObjectiveTerm(guide, guide.validation, recognizes=True, lasts=lasts, seconds=took)


def guide(goal: Goal, text: str, settings: WordSettings) -> tuple[GuidanceTerm, ...]:
    """Returns a term of guidance for all words of a goal, by the pipeline of a text. Raises ConfigError."""
    source = GuideSource.parse(text)
    said = ((term.words, term.weight) for term in goal.terms)
    return tuple(GuidanceTerm(words, source, weight, settings) for words, weight in said if words is not None)


class Guidance:
    """Score distillation: the gradient is (1 - kept share) (noise seen with the words - noise added), at the latents.

    words: the prompt, and what to avoid
    scale: of the guidance without a classifier (Ho and Salimans, 2022). The gradient is divided by it, so that it
    weighs about as much as a squared difference of pictures at any scale.
    calls: number of calls in which the most noise falls from nearly all to half of the timesteps
    """

    def __init__(self, network: "LatentDiffusion", words: "list[Words]", scale: float, seed: int, calls: int) -> None:
        self._network, self._words, self._scale, self._seed = network, words, scale, seed
        self._generator = torch.Generator().manual_seed(seed)
        self._calls, self._of = 0, calls

    def __call__(self, picture: Tensor) -> Tensor:
        """Returns a number whose gradient is the guidance for a picture [3, H, W]; half its mean square."""
        share = _CLOSEST + (1 - _CLOSEST) * torch.rand((), generator=self._generator).item()
        down, across = torch.rand(2, generator=self._generator).tolist()
        most = _MAX_NOISE + (_MAX_AT_END - _MAX_NOISE) * min(1.0, self._calls / self._of)
        chance = torch.rand((), generator=self._generator).item()
        self._calls += 1
        _, rows, columns = picture.shape
        height, width = max(1, round(share * rows)), max(1, round(share * columns))
        top, left = round(down * (rows - height)), round(across * (columns - width))
        latents = self._latents(picture[:, top : top + height, left : left + width])
        noise = self._noise(latents, self._generator)
        timestep = self._timestep(_MIN_NOISE + (most - _MIN_NOISE) * chance)
        slope = self.slope(latents.detach(), timestep, noise, self._words[0])
        return 0.5 * (latents - (latents - slope).detach()).square().mean()

    def slope(self, latents: Tensor, timestep: int, noise: Tensor, wanted: "Words") -> Tensor:
        """Returns the guidance at latents [1, c, h, w] to which noise of that shape is added."""
        kept = self._network.kept[timestep].item()
        without, with_words = self._seen(latents, timestep, noise, wanted)
        guided = without + self._scale * (with_words - without)
        return (1 - kept) / self._scale * (guided - noise)

    @torch.no_grad()
    def validation(self, picture: Tensor) -> Tensor:
        """Returns the error of the noise that is seen with the words, as a share of that without.

        It is 1 if the words say nothing of the picture. Noise and timesteps are always the same, and not those of the
        calls.
        """
        latents, generator = self._latents(picture), torch.Generator().manual_seed(self._seed + _APART)
        errors = []
        for share in _JUDGED:
            noise, timestep = self._noise(latents, generator), self._timestep(share)
            seen = self._seen(latents, timestep, noise, self._words[0])
            errors.append((seen - noise).square().mean((1, 2, 3)))
        without, with_words = torch.stack(errors).mean(0)
        return with_words / without.clamp(min=1e-12)

    def measure(self, rows: int, columns: int) -> float:
        """Returns the seconds of a gradient for pictures of that size: of a processor, or of another device's clock.

        Raises ConfigError if the gradient is not finite.
        """
        device = self._network.device
        clock: Callable[[], float] = time.thread_time if device.type == "cpu" else time.monotonic
        for _ in range(1 if device.type == "cpu" else 2):  # other devices choose their kernels at the first one
            began = clock()
            grey = torch.full((3, rows, columns), 0.5, device=device, requires_grad=True)
            with torch.enable_grad():
                (slope,) = torch.autograd.grad(self(grey), grey)
        if not bool(slope.isfinite().all()):
            raise ConfigError(f"The guidance of {self._network.name} is not finite; name another pipeline.")
        return clock() - began

    def _latents(self, picture: Tensor) -> Tensor:
        size = self._network.size(*picture.shape[1:])
        seen = functional.interpolate(picture[None], list(size), mode="bilinear", antialias=True)[0]
        return self._network.encode(seen)

    def _noise(self, latents: Tensor, generator: torch.Generator) -> Tensor:
        return send_to_device(torch.randn(latents.shape, generator=generator), latents.device)

    def _timestep(self, share: float) -> int:
        return min(len(self._network.kept) - 1, round(share * len(self._network.kept)))

    def _seen(self, latents: Tensor, timestep: int, noise: Tensor, wanted: "Words") -> Tensor:
        """Returns the noise [2, c, h, w] that is seen in noisy latents, without the words and with them."""
        kept = self._network.kept[timestep].item()
        noisy = kept**0.5 * latents + (1 - kept) ** 0.5 * noise
        return self._network.noise_in(noisy, timestep, [self._words[-1], wanted])
