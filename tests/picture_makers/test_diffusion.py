"""The maker `diffusers`: tiny pipelines that are made here, from words to a plan, and those that fail."""

import json
import re
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from http.server import ThreadingHTTPServer
from pathlib import Path
from shutil import copytree
from threading import Thread
from types import SimpleNamespace
from typing import Any, ClassVar

import huggingface_hub.constants
import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from frida_painter.errors import ConfigError, Interrupted, MakingFailed, StorageError
from frida_painter.objectives.weights.pipeline_folder import PipelineFolder
from frida_painter.runs.spec import RunSpec
from frida_painter.system import images
from frida_painter.system.python_process import OwnProcess
from frida_painter_words.picture_makers import pipeline_process
from frida_painter_words.picture_makers.diffusion import DiffusionMaker
from frida_painter_words.picture_makers.making import MakingWish, PictureRequest, make_pictures
from frida_painter_words.picture_makers.pipeline_process import PipelineAnswer, PipelineTask, _require_picture
from frida_painter_words.picture_makers.pipeline_process import make_pictures as make_pictures_of
from killing import call_here
from objectives.weights.test_hub_folder import Answers
from tiny_pipelines import write_flux, write_lookalike, write_pipeline, write_stable_diffusion_3

pytestmark = pytest.mark.filterwarnings("ignore")  # of both libraries, about their own settings


@pytest.fixture(scope="module")
def pipeline(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pipeline(tmp_path_factory.mktemp("pipelines") / "tiny")


def ask(folder: Path, told: list[str] | None = None, seeds: tuple[int, ...] = (7,), seconds: float = 200.0,
        stop: Callable[[], bool] = lambda: False) -> PictureRequest:  # fmt: skip
    folder.mkdir()
    tell = [].append if told is None else told.append
    return PictureRequest("a lemon", seeds, 512, 384, folder, torch.device("cpu"), seconds, stop, tell)


@contextmanager
def as_alone() -> Iterator[None]:
    """Lets this process do what a pipeline's process does, which ends with the methods that it replaces."""
    from diffusers import ModelMixin
    from transformers import PreTrainedModel

    with pytest.MonkeyPatch.context() as usual:
        for network in (ModelMixin, PreTrainedModel):
            usual.setattr(network, "from_pretrained", vars(network)["from_pretrained"])
        yield


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pipelines run in the process of the test, which has loaded their libraries."""

    def call(self: OwnProcess[..., None], *given: Any) -> None:
        with as_alone():
            call_here(self, *given)

    monkeypatch.setattr(OwnProcess, "__call__", call)


@pytest.mark.usefixtures("here")
def test_pictures_follow_their_seeds_and_steps_are_told(tmp_path: Path, pipeline: Path) -> None:
    told: list[str] = []
    maker = DiffusionMaker.parse(f"{pipeline},steps=2")
    first, second, again = (images.load(Path(str(file))) for file in maker.make(ask(tmp_path / "a", told, (7, 8, 7))))
    assert first.shape == (3, 56, 72), "4 to 3 in about as many pixels as its networks were made for"
    assert torch.equal(first, again) and not torch.equal(first, second)
    assert told[:2] == ["Reading tiny.", "Loading tiny on cpu."]
    assert told[2:4] == [f"Picture 1 of 3: step {n} of 2." for n in (1, 2)]
    assert len(told) == 8 and maker.facts["steps"] == "2 steps" and len(maker.facts["sha256"].split()) == 3


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    "words", ["a lemon " * 1200, "καράβι 帆船", "🙂"], ids=["10,000 characters", "alphabets", "emoji"]
)
def test_any_words_make_a_picture_and_a_tokenizer_need_not_say_how_many_it_takes(
    tmp_path: Path, pipeline: Path, words: str
) -> None:
    folder = copytree(pipeline, tmp_path / "endless")
    settings = json.loads((folder / "tokenizer" / "tokenizer_config.json").read_text())
    del settings["model_max_length"]
    (folder / "tokenizer" / "tokenizer_config.json").write_text(json.dumps(settings))
    request = replace(ask(tmp_path / "made"), words=words)
    (made,) = DiffusionMaker.parse(f"{folder},steps=1").make(request)
    assert images.load(Path(str(made))).shape == (3, 56, 72)


@pytest.mark.usefixtures("here")
def test_a_making_by_a_pipeline_is_recorded(tmp_path: Path, pipeline: Path) -> None:
    told: list[str] = []
    spec = RunSpec.of(goal=[{"text": "a red tower"}], canvas="12x9cm", seed=3)
    made = make_pictures(
        MakingWish("a red tower", f"diffusers:{pipeline}", 2), tmp_path / "made", spec, tell=told.append
    )
    made.choose(0, "it is the first")
    assert "Picture 2 of 2: step 4 of 4." in told and "tiny, StableDiffusionPipeline, 4 steps" in made.made_by
    record = json.loads((tmp_path / "made" / "making.json").read_text())
    assert [one["seed"] for one in record["pictures"]] == [3, 4] and record["facts"]["model"] == "tiny"


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(("write", "size"), [(write_flux, (448, 576)), (write_stable_diffusion_3, (224, 288))])
def test_pipelines_of_transformers_make_pictures(
    tmp_path: Path, write: Callable[[Path], Path], size: tuple[int, int]
) -> None:
    request = replace(ask(tmp_path / "a"), width=576, height=448)
    (made,) = DiffusionMaker.parse(f"{write(tmp_path / 'net')},steps=2").make(request)
    assert images.load(Path(str(made))).shape == (3, *size)


def load(folder: Path) -> Any:
    """The pipeline of a folder, as the process loads it."""
    kind = json.loads((folder / "model_index.json").read_text())["_class_name"]
    with as_alone():
        return pipeline_process._load(task_of(folder, kind, folder), torch.device("cpu"), print)


def task_of(folder: Path, kind: str, pictures: Path, **more: Any) -> PipelineTask:
    """The task of making one picture by the pipeline in a folder."""
    usual: dict[str, Any] = {"canvas": None, "free": None} | more
    return PipelineTask(
        PipelineFolder(folder, "net", kind, (), None, 1), steps=2, hashes=None, words="a storm", seeds=(7,), width=512,
        height=384, device="cpu", pictures=pictures, **usual,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "protected", "used"),
    [
        ("StableDiffusionPipeline", False, "StableDiffusionImg2ImgPipeline"),
        ("StableDiffusionPipeline", True, "StableDiffusionInpaintPipeline"),
        ("StableDiffusionImg2ImgPipeline", False, "StableDiffusionImg2ImgPipeline"),
        ("StableDiffusionInpaintPipeline", True, "StableDiffusionInpaintPipeline"),
        ("StableDiffusionInstructPix2PixPipeline", False, "StableDiffusionInstructPix2PixPipeline"),
    ],
)
def test_each_kind_of_pipeline_begins_from_the_canvas(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, protected: bool, used: str
) -> None:
    """The networks are random, so that only this shows: a pipeline runs as that kind, and follows the canvas."""
    canvas, free = torch.full((3, 48, 64), 0.9), torch.zeros(3, 48, 64)
    canvas[:, :, :32], free[:, :, 32:] = 0.1, 1.0
    made = {}
    for name, seen in (("dark", canvas), ("grey", torch.full_like(canvas, 0.5))):
        folder = tmp_path / name
        folder.mkdir()
        images.save(seen, folder / "canvas.png")
        images.save(free, folder / "free.png")
        task = task_of(
            write_pipeline(tmp_path / "net", kind=kind), kind, folder, canvas=folder / "canvas.png",
            free=folder / "free.png" if protected else None,
        )  # fmt: skip
        answers: list[PipelineAnswer] = []
        with as_alone():
            make_pictures_of.function(task, print, answers.append)
        assert answers[-1].pipeline == used and answers[-1].faults == ("",), "which the record tells"
        made[name] = images.load(folder / "1.png")
    assert made["dark"].shape == (3, 56, 72) and not torch.equal(made["dark"], made["grey"])
    if kind != "StableDiffusionPipeline":
        with as_alone(), pytest.raises(MakingFailed, match="makes no picture from words alone"):
            pipeline_process._load(replace(task, canvas=None), torch.device("cpu"), print)


@pytest.mark.parametrize(
    ("write", "part"),
    [
        (write_pipeline, "unet"),
        (write_pipeline, "vae"),
        (write_pipeline, "text_encoder"),
        (write_flux, "transformer"),
        (write_flux, "text_encoder_2"),
        (write_stable_diffusion_3, "text_encoder_3"),
    ],
)
def test_a_pipeline_is_never_completed_by_chance(tmp_path: Path, write: Callable[[Path], Path], part: str) -> None:
    """Both libraries fill missing tensors with random numbers, and only log it."""
    folder = write(tmp_path / "net")
    assert load(folder).config
    (file,) = (folder / part).glob("*.safetensors")
    tensors = load_file(file)
    kept = {name: tensor for name, tensor in tensors.items() if not name.endswith("norm1.bias")}
    kept = dict(list(tensors.items())[2:]) if len(kept) == len(tensors) else kept
    save_file(kept, file, {"format": "pt"})
    with pytest.raises(MakingFailed) as told:
        load(folder)
    said = rf"net lacks {len(tensors) - len(kept)} of the \d+ tensors of its {part}; take an undamaged copy, or name "
    assert re.fullmatch(f"{said}another pipeline.", str(told.value))


@pytest.mark.parametrize(
    ("config", "knows"),
    [
        ({"guidance_embeds": True}, True),
        ({"guidance_embeds": False}, False),
        ({"time_cond_proj_dim": 8}, True),
        ({}, False),
    ],
)
def test_a_network_that_was_given_the_guidance_keeps_it(config: dict[str, Any], *, knows: bool) -> None:
    """Few steps go without guidance, but Flux of few steps and LCM have learned what it does."""
    network = SimpleNamespace(config=SimpleNamespace(**config))
    assert pipeline_process._knows_guidance(SimpleNamespace(transformer=network)) is knows


def blacken(folder: Path) -> None:
    write_pipeline(folder, bias=-50.0)


def spoil_numbers(folder: Path) -> None:
    write_pipeline(folder, bias=float("nan"))


def name_class(kind: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        index = write_lookalike(folder) / "model_index.json"
        index.write_text(index.read_text().replace("StableDiffusionPipeline", kind))

    return write


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("write", "says"),
    [
        (blacken, "Picture 1 of diffusers cannot be painted: it is black all over"),
        (spoil_numbers, "Picture 1 of net holds values that are no numbers (NaN); name another."),
        (name_class("NoSuchPipeline"), "net is a NoSuchPipeline, which diffusers"),
        (name_class("StableDiffusionImg2ImgPipeline"), "which makes no picture from words alone"),
    ],
)
def test_a_pipeline_that_fails_is_one_sentence(tmp_path: Path, write: Callable[[Path], Any], says: str) -> None:
    write(tmp_path / "net")
    spec = RunSpec.of(goal=[{"text": "a lemon"}], canvas="12x9cm")
    with pytest.raises(MakingFailed) as told:
        make_pictures(MakingWish("a lemon", f"diffusers:{tmp_path / 'net'}", 1), tmp_path / "made", spec)
    assert says in str(told.value) and "\n" not in str(told.value) and not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("failure", "says"),
    [
        (RuntimeError("no memory is left"), "failed (RuntimeError: no memory is left); name another"),
        (StorageError("The disk is full."), "The disk is full."),
    ],
)
def test_pictures_beside_one_of_nan_and_before_a_failure_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failure: Exception, says: str
) -> None:
    class Pipeline:
        """Makes one picture of NaN and breaks at the fourth."""

        count = 0

        def __call__(self, prompt: str, width: int, height: int) -> SimpleNamespace:
            self.count += 1
            if self.count == 4:
                raise failure
            return SimpleNamespace(images=[np.full((height, width, 3), np.nan if self.count == 2 else 0.5)])

    monkeypatch.setattr(pipeline_process, "_load", lambda task, device, tell: Pipeline())
    monkeypatch.setattr(OwnProcess, "__call__", call_here)
    maker = DiffusionMaker.parse(str(write_lookalike(tmp_path / "net")))
    first, second, third, fourth = maker.make(ask(tmp_path / "a", seeds=(7, 8, 9, 10)))
    assert isinstance(first, Path) and isinstance(third, Path) and images.load(third).shape == (3, 384, 512)
    assert str(second) == "Picture 2 of net holds values that are no numbers (NaN); name another."
    assert says in str(fourth) and maker.facts["size"] == "512 x 384"


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (SimpleNamespace(frames=np.zeros((1, 4, 6, 3))), "returned a SimpleNamespace without pictures"),
        (SimpleNamespace(images=np.zeros((3, 4, 6, 3))), "returned 3 pictures for one seed"),
        (SimpleNamespace(images=[]), "returned 0 pictures for one seed"),
        (SimpleNamespace(images=np.zeros((1, 6, 4, 3))), r"of the shape \(6, 4, 3\) where \(4, 6, 3\) was asked for"),
        (SimpleNamespace(images=np.zeros((1, 4, 6, 4))), r"of the shape \(4, 6, 4\)"),
        (SimpleNamespace(images=np.full((1, 4, 6, 3), np.inf)), "no numbers"),
    ],
)
def test_what_a_pipeline_may_not_return(made: Any, says: str) -> None:
    with pytest.raises(MakingFailed, match=says):
        _require_picture(made, "net", 1, 6, 4)


def test_a_stop_a_failure_and_the_end_of_its_time_end_a_pipeline(tmp_path: Path, pipeline: Path) -> None:
    began, told = time.monotonic(), []
    with pytest.raises(Interrupted, match="You stopped the making"):
        DiffusionMaker.parse(f"{pipeline},steps=50").make(
            ask(tmp_path / "a", told, tuple(range(16)), stop=lambda: any("step" in one for one in told))
        )
    assert not any("Picture 16" in one for one in told)
    settings = copytree(pipeline, tmp_path / "spoiled") / "unet" / "config.json"
    settings.write_text(settings.read_text().replace("CrossAttnDownBlock2D", "NoSuchBlock"))
    with pytest.raises(MakingFailed, match=r"^The pipeline failed \("):
        DiffusionMaker.parse(str(tmp_path / "spoiled")).make(ask(tmp_path / "c"))
    with pytest.raises(MakingFailed, match="The pipeline was not finished after 0 s"):
        DiffusionMaker.parse(str(pipeline)).make(ask(tmp_path / "b", seconds=0.5))
    assert time.monotonic() - began < 100


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "was given no pipeline; fetch one with `frida-painter models fetch imagine`, or write for example"),
        ("no such folder", "'no such folder' is neither a folder that is here nor a name on the hub"),
        ("/no/such/folder", "is neither a folder"),
        ("holidays", "is neither a folder"),
        ("some/net,steps=0", "0 steps were asked for; a pipeline takes 1 to 200"),
        ("some/net,steps=201", "201 steps"),
        ("file.txt", "is a file; name the folder"),
        ("a" * 5000, "is neither a folder|cannot be read"),
    ],
)
def test_what_is_refused_before_anything(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, says: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").touch()
    with pytest.raises(ConfigError, match=says):
        DiffusionMaker.parse(text)


@pytest.fixture
def hub(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Answers]]:
    """A hub on this machine with the repository some/clip, empty at first, and a cache of its own."""

    class Hub(Answers):
        files: ClassVar[dict[str, bytes]] = {}
        asked: ClassVar[list[str]] = []

    monkeypatch.setenv("HF_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("HF_HUB_DISABLE_XET", "1")
    monkeypatch.delenv("HF_HUB_OFFLINE", raising=False)
    monkeypatch.delenv("HF_HUB_CACHE", raising=False)
    monkeypatch.setattr(huggingface_hub.constants, "HF_HUB_CACHE", str(tmp_path / "cache" / "hub"))
    with ThreadingHTTPServer(("127.0.0.1", 0), Hub) as server:
        monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{server.server_port}")
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield Hub
        server.shutdown()
        thread.join()


def publish(hub: type[Answers], folder: Path) -> None:
    files = (file for file in folder.rglob("*") if file.is_file())
    hub.files = {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


@pytest.mark.usefixtures("here")
def test_a_name_on_the_hub_is_fetched_once_without_pickles(tmp_path: Path, pipeline: Path, hub: type[Answers]) -> None:
    publish(hub, pipeline)
    unwanted = {f"unet/diffusion_pytorch_model.{end}": b"" for end in ("bin", "fp16.safetensors")} | {"README.md": b"#"}
    hub.files = {**hub.files, **unwanted}
    told: list[str] = []
    maker = DiffusionMaker.parse("some/clip")
    assert maker.here is None and not hub.asked, "nothing is fetched before pictures are made"
    assert len(maker.make(ask(tmp_path / "a", told))) == 1 and maker.facts["model"] == "some/clip"
    assert told[0].startswith("Fetching some/clip from http://127.0.0.1") and told[0].endswith("once, 0 MB.")
    assert not {*unwanted} & {*hub.asked}
    hub.asked.clear()
    there = DiffusionMaker.parse("some/clip")
    assert there.here is not None and there.here.steps == 4
    there.make(ask(tmp_path / "b"))
    assert not hub.asked, "what is here is not asked for"
    there.here.weights[0].unlink()
    assert DiffusionMaker.parse("some/clip").here is None, "half a download is fetched again"


def test_names_that_the_hub_does_not_have_and_hubs_that_are_not_there(
    tmp_path: Path, hub: type[Answers], monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(MakingFailed, match=r"somebody/else cannot be fetched from the hub \(.*404"):
        DiffusionMaker.parse("somebody/else").make(ask(tmp_path / "a"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    with pytest.raises(MakingFailed, match="somebody/else cannot be fetched from the hub"):
        DiffusionMaker.parse("somebody/else").make(ask(tmp_path / "b"))
    monkeypatch.delenv("HF_HUB_OFFLINE")
    monkeypatch.setenv("HF_ENDPOINT", "http://127.0.0.1:9")
    with pytest.raises(MakingFailed, match=r"somebody/else cannot be fetched .*[Cc]onnection refused"):
        DiffusionMaker.parse("somebody/else").make(ask(tmp_path / "c"))
    tries: list[object] = []
    with socket.create_server(("127.0.0.1", 0)) as door:

        def shut_out() -> None:
            with suppress(OSError):  # the door is closed
                while True:
                    door.accept()[0].close()
                    tries.append(1)

        Thread(target=shut_out, daemon=True).start()
        monkeypatch.setenv("HF_ENDPOINT", f"http://127.0.0.1:{door.getsockname()[1]}")
        with pytest.raises(MakingFailed, match=r"somebody/else cannot be fetched from the hub"):
            DiffusionMaker.parse("somebody/else").make(ask(tmp_path / "d"))
    assert len(tries) == 1, "without retries"


def test_a_name_whose_pipeline_wants_code_is_refused_before_its_weights_come(
    tmp_path: Path, hub: type[Answers]
) -> None:
    index = write_lookalike(tmp_path / "net") / "model_index.json"
    index.write_text(index.read_text().replace('"StableDiffusionPipeline"', '["mine", "Mine"]'))
    publish(hub, tmp_path / "net")
    with pytest.raises(MakingFailed, match="wants code of its own to be run"):
        DiffusionMaker.parse("some/clip").make(ask(tmp_path / "a"))
    assert hub.asked == ["model_index.json"]
