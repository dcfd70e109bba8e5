"""Guidance by diffusion: its gradient, its seeds, what it leads to, what it refuses, and plans from words by it."""

import json
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor
from torch.nn import functional

from frida_painter import devices, registry
from frida_painter.canvas_size import CanvasSize
from frida_painter.errors import ConfigError
from frida_painter.frames import PixelGrid
from frida_painter.objectives import guidance
from frida_painter.objectives.encoders.latent_diffusion import LatentDiffusion, Words
from frida_painter.objectives.encoders.loading import EncoderRegistry
from frida_painter.objectives.guidance import Guidance, GuidanceTerm, GuideSource
from frida_painter.objectives.interpretation import prepare
from frida_painter.objectives.objective import Goal
from frida_painter.objectives.word_settings import WordSettings
from frida_painter.runs.goals import make_goal, tell_terms
from frida_painter.runs.settle import make_planner
from frida_painter.runs.spec import RunSpec
from frida_painter.weights.pipeline_folder import read_pipeline_folder
from tiny_pipelines import write_flux, write_lookalike, write_pipeline, write_stable_diffusion_xl

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pipeline(tmp_path_factory.mktemp("pipelines") / "tiny")


@pytest.fixture(scope="module")
def large(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_stable_diffusion_xl(tmp_path_factory.mktemp("pipelines") / "xl")


def load(folder: Path, told: list[str] | None = None) -> LatentDiffusion:
    tell = list[str]().append if told is None else told.append
    return LatentDiffusion.load(read_pipeline_folder(folder, folder.name), CPU, tell)


def guide(folder: Path, *said: str, scale: float = 100.0, seed: int = 0, calls: int = 10) -> Guidance:
    network = load(folder)
    return Guidance(network, network.read([*said, ""] if len(said) == 1 else list(said)), scale, seed, calls)


def noise_picture(seed: int = 0, rows: int = 48, columns: int = 64) -> Tensor:
    return torch.rand(3, rows, columns, generator=torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("which", ["pipeline", "large"])
def test_the_gradient_is_the_weighed_difference_of_noises_through_the_encoder(
    which: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    """w(t) (noise seen - noise added) at the latents, and finite differences of the encoder from there on."""
    made = guide(request.getfixturevalue(which), "a lemon", scale=7.5)
    network, heard = made._network, []
    network._vae.double()  # for the finite differences
    monkeypatch.setattr(guidance, "_CLOSEST", 1.0)

    def hear(latents: Tensor, timestep: int, noise: Tensor, wanted: Words) -> Tensor:
        heard.append((latents, timestep, noise, slope(latents, timestep, noise, wanted)))
        return heard[-1][-1]

    slope = made.slope
    monkeypatch.setattr(made, "slope", hear)
    picture = noise_picture().double().requires_grad_()
    (found,) = torch.autograd.grad(made(picture), picture)
    ((latents, timestep, noise, asked),) = heard

    kept = float(network.kept[timestep])
    noisy = kept**0.5 * latents + (1 - kept) ** 0.5 * noise
    without, wanted = network.noise_in(noisy, timestep, [made._words[-1], made._words[0]])
    assert torch.allclose(asked, (1 - kept) * (without + 7.5 * (wanted - without) - noise) / 7.5, atol=1e-5)

    def surrogate(at: Tensor) -> float:
        return float((asked.double() * made._latents(at).double()).mean())

    way = torch.randn(picture.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    with torch.no_grad():
        step = 1e-3
        measured = (surrogate(picture + step * way) - surrogate(picture - step * way)) / (2 * step)
    assert float((found * way).sum()) == pytest.approx(measured, rel=0.02)


class OnePicture:
    """A network that knows one picture of words, and nothing without words: its noise is told by a formula."""

    name, device = "one", CPU
    kept = torch.linspace(0.9991, 0.001, 1000)

    def __init__(self, target: Tensor) -> None:
        self.target = self.encode(target)

    def size(self, rows: int, columns: int) -> tuple[int, int]:
        return 12, 16

    def encode(self, picture: Tensor) -> Tensor:
        return 2 * picture[None] - 1

    def noise_in(self, noisy: Tensor, timestep: int, words: list[Words]) -> Tensor:
        clear, rest = self.kept[timestep].sqrt(), (1 - self.kept[timestep]).sqrt()
        return torch.cat([(noisy - clear * self.target * float(each.tokens)) / rest for each in words])


def test_it_leads_to_the_picture_that_the_network_knows() -> None:
    target = functional.interpolate(noise_picture(5, 3, 4)[None], (12, 16))[0]
    words = [Words(torch.tensor(1.0), None), Words(torch.tensor(0.0), None)]
    made: Any = Guidance(OnePicture(target), words, 1.0, 0, 300)  # type: ignore[arg-type]
    picture = torch.full_like(target, 0.5).requires_grad_()
    before = made.validation(picture), (picture - target).square().mean().item()
    adam = torch.optim.Adam([picture], 0.02)
    for _ in range(300):
        adam.zero_grad()
        made(picture).backward()
        adam.step()
    assert (picture - target).square().mean() < 0.1 * before[1] and made.validation(picture) < 0.5 * before[0]


def test_calls_follow_the_seed_and_the_judgement_is_always_the_same(pipeline: Path) -> None:
    one, same, other = guide(pipeline, "a"), guide(pipeline, "a"), guide(pipeline, "a", seed=1)
    picture = noise_picture()
    first, second = one(picture), one(picture)
    judged = one.validation(picture)
    assert torch.equal(first, same(picture)) and not torch.equal(first, second)
    assert not torch.equal(first, other(picture))
    assert torch.equal(judged, same.validation(picture)) and 0.5 < float(judged) < 2
    assert not torch.equal(judged, one.validation(1 - picture))


def test_the_most_noise_falls_during_the_work(pipeline: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made, heard = guide(pipeline, "a", calls=30), []
    monkeypatch.setattr(
        made, "slope", lambda latents, timestep, *_: heard.append(timestep) or torch.zeros_like(latents)
    )
    for _ in range(60):
        made(noise_picture())
    assert max(heard[:30]) > 600 and max(heard[30:]) <= 500 and min(heard) >= 20


def test_what_to_avoid_counts(pipeline: Path) -> None:
    plain, picture = guide(pipeline, "a lemon", ""), noise_picture()
    assert not torch.equal(plain.validation(picture), guide(pipeline, "a lemon", "grey").validation(picture))


@pytest.mark.parametrize("kind", ["epsilon", "v_prediction", "sample"])
def test_networks_that_predict_something_else_tell_the_same_noise(pipeline: Path, kind: str) -> None:
    network = load(pipeline)
    latents, noise = torch.randn(2, 1, 4, 8, 8, generator=torch.Generator().manual_seed(1))
    kept = network.kept[400]
    clear, rest = kept.sqrt(), (1 - kept).sqrt()
    answers = {"epsilon": noise, "sample": latents, "v_prediction": clear * noise - rest * latents}
    unet = lambda *_, **__: SimpleNamespace(sample=answers[kind])  # noqa: E731
    network._unet, network._kind = unet, kind
    found = network.noise_in(clear * latents + rest * noise, 400, [Words(torch.zeros(1, 2, 8), None)])
    assert torch.allclose(found, noise, atol=1e-5)


def test_pictures_are_seen_in_their_proportions_and_at_any_size(pipeline: Path) -> None:
    made = guide(pipeline, "a")
    assert made._network.size(48, 64) == (56, 72) and made._network.size(10, 400) == (12, 404)
    assert float(made(noise_picture(rows=7, columns=300))) >= 0


@pytest.mark.parametrize("prompt", ["", "été", "Ж漢字🙂", "a " * 5000])
def test_any_words_can_be_read(pipeline: Path, prompt: str) -> None:
    (found,) = load(pipeline).read([prompt])
    assert found.tokens.shape == (1, 77, 8) and bool(found.tokens.isfinite().all())


def test_a_tokenizer_that_knows_no_end_is_cut_to_the_network(pipeline: Path, tmp_path: Path) -> None:
    folder = Path(copytree(pipeline, tmp_path / "net"))
    file = folder / "tokenizer" / "tokenizer_config.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "model_max_length": 10**30}))
    (found,) = load(folder).read(["a lemon"])
    assert found.tokens.shape == (1, 77, 8)


def test_stable_diffusion_xl_forgets_words_that_are_not_there(large: Path) -> None:
    said, nothing = load(large).read(["a lemon", ""])
    assert said.tokens.shape == (1, 77, 16) and said.summary is not None and said.summary.shape == (1, 8)
    assert not bool(nothing.tokens.any()) and nothing.summary is not None and not bool(nothing.summary.any())


# Pipelines and sources that are refused


def change(part: str, **settings: Any) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        file = folder / part
        kept = {key: value for key, value in {**json.loads(file.read_text()), **settings}.items() if value is not None}
        file.write_text(json.dumps(kept))

    return write


def tensors(part: str, alter: Callable[[dict[str, Tensor]], dict[str, Tensor]]) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (file,) = (folder / part).glob("*.safetensors")
        save_file(alter(load_file(file)), file, {"format": "pt"})

    return write


SCHEDULER, UNET = "scheduler/scheduler_config.json", "unet/config.json"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "spoil",
    [
        change(SCHEDULER, beta_schedule=None, trained_betas=None),
        change(SCHEDULER, beta_schedule="unheard of"),
        change(SCHEDULER, prediction_type="flow_prediction"),
        change(SCHEDULER, beta_start=0.5, beta_end=-0.5),
        change(SCHEDULER, num_train_timesteps=1),
        change(UNET, in_channels=9),
        change(UNET, in_channels=8, out_channels=8),
        change(UNET, addition_embed_type="image"),
        change(UNET, num_class_embeds=3),
        change(UNET, cross_attention_dim=12),
        change("vae/config.json", latent_channels=16),
        change("vae/config.json", block_out_channels=None),
        change("model_index.json", vae=["diffusers", "AutoencoderTiny"]),
        tensors("unet", lambda all: {**all, "conv_in.bias": all["conv_in.bias"] * float("nan")}),
        tensors("vae", lambda all: {**all, "encoder.conv_in.bias": all["encoder.conv_in.bias"] * float("nan")}),
        tensors("text_encoder", lambda all: {key: value * float("nan") for key, value in all.items()}),
        tensors("unet", lambda all: dict(list(all.items())[2:])),
        tensors("text_encoder", lambda all: dict(list(all.items())[1:])),
        lambda folder: (folder / "tokenizer" / "tokenizer.json").write_text("{}"),
    ],
)  # fmt: skip
def test_a_pipeline_that_cannot_guide_is_refused(
    pipeline: Path, tmp_path: Path, spoil: Callable[[Path], object]
) -> None:
    folder = Path(copytree(pipeline, tmp_path / "net"))
    spoil(folder)
    with pytest.raises(ConfigError) as told:
        guide(folder, "a lemon")
    assert "net" in str(told.value) and "\n" not in str(told.value) and len(str(told.value)) < 400


@pytest.mark.parametrize("write", [write_flux, write_lookalike])
def test_other_kinds_of_pipelines_are_refused(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    with pytest.raises(ConfigError, match="UNet2DConditionModel"):
        load(write(tmp_path / "net"))


def test_the_memory_is_told_and_required(pipeline: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    load(pipeline, told)
    assert "memory" in told[0] and "tiny" in told[0]
    monkeypatch.setattr(devices, "free_memory", lambda device: 10**6)
    with pytest.raises(ConfigError, match="1 MB are free"):
        load(pipeline)


@pytest.mark.parametrize(
    "text",
    ["", "flux", "command:x", "diffusers:", "diffusers: ", "diffusers:no such folder", "diffusers:x\0",
     "diffusers:{here},scale=0.5", "diffusers:{here},scale=1e9", "diffusers:{here},scale=.", "diffusers:{here}/unet",
     "diffusers:{here}/model_index.json"],
)  # fmt: skip
def test_sources_that_are_none(pipeline: Path, text: str) -> None:
    with pytest.raises(ConfigError):
        GuideSource.parse(text.format(here=pipeline))


@pytest.mark.parametrize("scale", ["abc", "", "7.5.1", "nan", "-3", "1" * 40])
def test_scales_that_are_none(pipeline: Path, scale: str) -> None:
    with pytest.raises(ConfigError, match="scale"):
        GuideSource.parse(f"diffusers:{pipeline},scale={scale}")


def test_a_scale_and_a_usual_one(pipeline: Path) -> None:
    assert GuideSource.parse(f"diffusers:{pipeline},scale=7.5").scale == 7.5
    assert GuideSource.parse(f"diffusers:{pipeline}").scale == 100


def test_without_diffusers_the_command_that_installs_it_is_told(
    pipeline: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(registry, "is_installed", lambda package: package != "diffusers")
    with pytest.raises(ConfigError, match="diffusers"):
        GuideSource.parse(f"diffusers:{pipeline}")


@pytest.mark.parametrize("goal", [{"goal": [{"image": "a.jpg"}]}, {"together": True},
                                  {"goal": [{"image": "a.jpg"}], "initial": [{"text": "a lemon"}]}])  # fmt: skip
def test_a_guide_without_words_is_refused(goal: Any) -> None:
    with pytest.raises(ConfigError, match="--guide"):
        RunSpec.of(**goal, guide="diffusers:x")


# Plans


def test_all_grids_of_a_plan_share_one_guide_and_its_facts_are_kept(pipeline: Path, tmp_path: Path) -> None:
    encoders, told = EncoderRegistry(tmp_path), []
    encoders.tell = told.append
    goal = tell_terms(make_goal(text=["a lemon", "a tower"]), WordSettings(avoid="grey"), 0.5, f"diffusers:{pipeline}")
    goal = Goal(goal.terms[2:])
    shared: dict[str, Any] = {}
    size = CanvasSize(0.12, 0.09)
    made = [
        prepare(goal, PixelGrid.of_height(size, rows), encoders, iterations=100, shared=shared) for rows in (32, 64)
    ]
    assert len(shared) == 2 and len([line for line in told if line.startswith("Loading")]) == 1
    (choice,) = encoders.choices
    assert choice.purpose == "words" and len(choice.hashes.split()) == 3
    step = made[0].measure_step(noise_picture())
    assert step is not None and step > 0


def test_a_guide_makes_the_same_plan_from_the_same_seed(pipeline: Path, tmp_path: Path) -> None:
    def plan(**more: Any) -> str:
        planner = make_planner(
            make_goal(text="a red tower"), encoders=EncoderRegistry(tmp_path), guide=f"diffusers:{pipeline}",
            canvas="12x9cm", strokes=3, colors=2, render_height=64, effort=0.05, **more,
        )  # fmt: skip
        return planner.plan().digest

    first = plan()
    assert plan() == first != plan(seed=1)


@pytest.mark.parametrize(
    ("beginning", "clip", "composes", "terms"),
    [("auto", False, False, 1), ("auto", False, True, 2), ("nothing", False, True, 1), ("nothing", True, True, 2)],
)
def test_words_that_nothing_else_reads_are_left_to_the_guide(
    pipeline: Path, beginning: Any, clip: bool, composes: bool, terms: int
) -> None:
    goal = tell_terms(make_goal(text="a lemon"), WordSettings(beginning), 0.5, f"diffusers:{pipeline}")
    context: Any = SimpleNamespace(encoders=SimpleNamespace(reads_by_clip=clip, composes=composes))
    assert len(GuidanceTerm.interpret(goal, context).terms) == terms


def test_a_description_keeps_the_whole_path_of_its_guide(pipeline: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(pipeline.parent)
    spec = RunSpec.of(goal=[{"text": "a lemon"}], guide="diffusers:tiny,scale=20")
    assert spec.record()["guide"] == f"diffusers:{pipeline.resolve()},scale=20"
    assert RunSpec.of(goal=[{"text": "a lemon"}], guide="diffusers:a/b").record()["guide"] == "diffusers:a/b"
