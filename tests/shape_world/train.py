"""Training of the eye that reads and sees the small world: a CLIP of `transformers`, saved as an ordinary folder.

    PYTHONPATH=src:tests python -m shape_world.train FOLDER [--steps 3000] [--seed 1]

First the eye learns to read. Each part of a picture's content (a ground, a count, the shape on the left) has a code,
at right angles to all others; a sentence is embedded as the sum of its parts' codes. So a new sentence of known parts
has a known place, however its words are turned.

Then it learns to see, by three losses at once. Likeness: a picture is where its sentence is. Contrast: pictures and
sentences find each other, among neighbours that differ in one word and pictures that blobs have spoiled. Denoising:
the gradient of a likeness, at a picture that was disturbed, points to the picture itself. So an optimiser that follows
the likeness paints the picture, and no pattern that only fools the eye; compare denoising score matching (Vincent, "A
connection between score matching and denoising autoencoders", 2011).
"""

import argparse
import json
import math
import random
import time
from itertools import product
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from frida_painter.objectives.semantic import Views
from shape_world import world
from shape_world.world import COLOR_NAMES, PLACES, RELATIONS, SHAPES, Picture, Thing

SIDE, PATCH = 24, 8  # pixels of the eye's picture and of a patch: too coarse for fine patterns
_DRAWN = SIDE * 5 // 4  # side of a drawing; `Views` looks at it
_GROUPS = 20  # of a batch; a group is a picture, a neighbour, and the picture spoiled by a blob
_LESSON, _LESSONS = 600, 6  # groups of a lesson, and lessons: each is drawn once and seen several times
_MEAN = torch.tensor([0.48145466, 0.4578275, 0.40821073])[:, None, None]
_SPREAD = torch.tensor([0.26862954, 0.26130258, 0.27577711])[:, None, None]
_READING, _SENTENCES, _READING_RATE = 1500, 256, 3e-3  # steps, sentences of each, and rate of learning to read
_KINDS = ("1", "2", "3", "left of", "above")
_SLOTS = ("each", "left", "right", "upper", "lower")  # what a colour or a shape belongs to
_PARTS = (
    *_KINDS, *(f"{color} ground" for color in COLOR_NAMES), *(f"at {place}" for place in ("", *PLACES)),
    *(f"{slot} {part}" for slot in _SLOTS for part in (*COLOR_NAMES, *SHAPES)),
    *(f"{count} {shape}" for count in (2, 3) for shape in SHAPES),  # in rows that differ with the shape
)  # fmt: skip
_LEVELS = {1: 0.25, 3: 0.3, 6: 0.3, 12: 0.25, SIDE: 0.12}  # cells of a side, and standard deviation of their noise
_LIKE, _PULL = 2.0, 8.0  # weights of likeness and denoising, relative to the contrast's
_FROM = 0.1  # share of the steps without it: content must be seen first


def _list_parts(picture: Picture) -> list[str]:
    """Returns the names of all parts of a picture's content, in _PARTS."""
    upright = picture.set_upright()
    one, two, ground = upright.thing, upright.other, f"{upright.ground} ground"
    if two is None:
        shape = f"{'each' if picture.count == 1 else picture.count} {one.shape}"
        return [str(picture.count), ground, f"at {picture.place}", f"each {one.color}", shape]
    first, second = ("left", "right") if upright.relation == "left of" else ("upper", "lower")
    return [upright.relation, ground, f"{first} {one.color}", f"{first} {one.shape}",
            f"{second} {two.color}", f"{second} {two.shape}"]  # fmt: skip


def list_pictures() -> list[Picture]:
    """Returns the pictures of all sentences of the world."""
    found = []
    for ground, color, shape in product(COLOR_NAMES, COLOR_NAMES, SHAPES):
        if color == ground:
            continue
        thing = Thing(color, shape)
        found += [Picture(thing, place=place, ground=ground) for place in ("", *PLACES)]
        found += [Picture(thing, count=count, ground=ground) for count in (2, 3)]
        others = [Thing(*other) for other in product(COLOR_NAMES, SHAPES) if other[0] != ground]
        found += [
            Picture(thing, relation=relation, other=other, ground=ground)
            for other, relation in product(others, RELATIONS)
            if other != thing
        ]
    return found


class Lesson:
    """Groups of drawings, each a picture, a neighbour and the first spoiled."""

    def __init__(self, groups: int, seed: int) -> None:
        chance = random.Random(seed)
        self.pairs: list[tuple[Picture, Picture]] = []
        while len(self.pairs) < groups:
            one = world.choose_picture(chance)
            skipped = 0.3 if one.other else 0.4 if one.count == 1 else 0.0  # of which kind more is to be learned
            if chance.random() < skipped:
                continue
            other = world.change_word(one, chance)
            if not one.is_kept_aside and not other.is_kept_aside:
                self.pairs.append((one, other))
        shown = [(picture, spoils) for a, b in self.pairs for picture, spoils in ((a, False), (b, False), (a, True))]
        fields = world.make_stroke_fields(seed, _DRAWN)
        layouts = [world.lay_out(picture, chance, float(spoils)) for picture, spoils in shown]
        drawn = [
            world.draw(layouts[first : first + 300], chance.randrange(2**31), fields)
            for first in range(0, len(layouts), 300)
        ]
        self.seen = torch.cat(drawn).half()


def write_tokenizer(folder: Path) -> None:
    """Writes the files of a tokenizer that knows the words of the world, and no other."""
    from tokenizers import Tokenizer, models, pre_tokenizers, processors

    words = ["<|startoftext|>", "<|endoftext|>", "<unk>", *dict.fromkeys(world.WORDS)]
    tokenizer = Tokenizer(models.WordLevel({word: number for number, word in enumerate(words)}, unk_token="<unk>"))
    tokenizer.pre_tokenizer = pre_tokenizers.Whitespace()
    tokenizer.post_processor = processors.TemplateProcessing(
        single="<|startoftext|> $A <|endoftext|>", special_tokens=[("<|startoftext|>", 0), ("<|endoftext|>", 1)]
    )
    folder.mkdir(parents=True, exist_ok=True)
    tokenizer.save(str(folder / "tokenizer.json"))
    settings = {"tokenizer_class": "PreTrainedTokenizerFast", "bos_token": words[0], "eos_token": words[1],
                "pad_token": words[1], "unk_token": words[2]}  # fmt: skip
    (folder / "tokenizer_config.json").write_text(json.dumps(settings))


def make_model(seed: int) -> nn.Module:
    """Returns the network before its training."""
    from transformers import CLIPConfig, CLIPModel

    text = {"hidden_size": 64, "intermediate_size": 128, "num_hidden_layers": 2, "num_attention_heads": 4,
            "hidden_act": "gelu", "vocab_size": 32, "max_position_embeddings": 20, "eos_token_id": 1,
            "bos_token_id": 0}  # fmt: skip
    vision = {"hidden_size": 96, "intermediate_size": 192, "num_hidden_layers": 3, "num_attention_heads": 6,
              "hidden_act": "gelu", "image_size": SIDE, "patch_size": PATCH}  # fmt: skip
    torch.manual_seed(seed)
    settings = CLIPConfig(text_config=text, vision_config=vision, projection_dim=96, logit_scale_init_value=2.3)
    model = CLIPModel._from_config(settings, attn_implementation="eager")  # the only one with a second derivative
    with torch.no_grad():  # places count from the beginning as much as colours
        model.vision_model.embeddings.position_embedding.weight.normal_(0, 0.3)
    return model


def disturb(pictures: Tensor, chance: torch.Generator) -> Tensor:
    """Returns pictures [n, 3, h, w] with noise of all sizes, mixed with others: what an optimiser may begin with."""
    n = len(pictures)
    noise = torch.zeros_like(pictures)
    for cells, spread in _LEVELS.items():
        level = spread * torch.rand(n, 1, 1, 1, generator=chance) * torch.randn(n, 3, cells, cells, generator=chance)
        noise = noise + functional.interpolate(level, pictures.shape[2:], mode="bicubic", align_corners=False)
    others = pictures[torch.randperm(n, generator=chance)]
    gray = torch.rand(n, 3, 1, 1, generator=chance)
    others = torch.where(torch.rand(n, 1, 1, 1, generator=chance) < 0.4, gray, others)
    share = torch.rand(n, 1, 1, 1, generator=chance) * (torch.rand(n, 1, 1, 1, generator=chance) < 0.6)
    size = 1.3 * torch.rand(n, 1, 1, 1, generator=chance)
    return (pictures + share * (others - pictures) + size * noise).clamp(0, 1)


def _climb(model: nn.Module, pictures: Tensor, words: Tensor, chance: torch.Generator) -> Tensor:
    """Returns pictures [n, 3, h, w] after two steps by which an optimiser would bring them nearer to the words."""
    for _ in range(2):
        slope = _follow(model, pictures.detach().requires_grad_(), words, create_graph=False)
        step = torch.zeros_like(slope)
        for cells in (3, 6, 12, SIDE):
            level = functional.interpolate(functional.adaptive_avg_pool2d(slope, cells), SIDE, mode="bilinear")
            step = step + level / (level.square().mean((1, 2, 3), keepdim=True).sqrt() + 1e-9)
        length = 0.1 * torch.rand(len(pictures), 1, 1, 1, generator=chance)
        pictures = (pictures + length * step).clamp(0, 1)
    return pictures.detach()


def _follow(model: nn.Module, pictures: Tensor, words: Tensor, *, create_graph: bool) -> Tensor:
    """Returns the gradient of the likeness of pictures [n, 3, h, w], which require one, and embedded words [n, d]."""
    seen = functional.normalize(model.get_image_features((pictures - _MEAN) / _SPREAD).pooler_output, dim=1)
    return torch.autograd.grad((seen * words).sum(), pictures, create_graph=create_graph)[0]


def _differ(slope: Tensor, wanted: Tensor) -> Tensor:
    """Returns 1 - cosine of gradients [n, 3, h, w] and those that are wanted: mean over pictures and several sizes."""
    total = slope.new_zeros(())
    for cells in (3, 6, 12, SIDE):
        found, goal = (functional.adaptive_avg_pool2d(part, cells).flatten(1) for part in (slope, wanted))
        total = total + 1 - functional.cosine_similarity(found, goal, dim=1, eps=1e-6).mean()
    return total / 4


def learn_to_read(model: nn.Module, tokenizer: Any, seed: int, steps: int) -> dict[Picture, Tensor]:
    """Trains the text tower; returns the embedded sentences [d] of all pictures that are not kept aside.

    steps: 0 if it can read already
    """
    every = list_pictures()
    torch.manual_seed(seed)
    codes = nn.init.orthogonal_(torch.empty(len(_PARTS), model.config.projection_dim))
    told = torch.tensor([[name in _list_parts(picture) for name in _PARTS] for picture in every]).float()
    wanted = functional.normalize(told @ codes, dim=1)
    tokens = tokenizer([picture.say() for picture in every], padding=True, return_tensors="pt")
    aside = torch.tensor([picture.is_kept_aside for picture in every])
    known = (~aside).nonzero()[:, 0]

    def embed(which: Tensor) -> Tensor:
        said = model.get_text_features(tokens["input_ids"][which], attention_mask=tokens["attention_mask"][which])
        return functional.normalize(said.pooler_output, dim=1)

    learned = [*model.text_model.parameters(), *model.text_projection.parameters()]
    optimiser = torch.optim.AdamW(learned, _READING_RATE, weight_decay=0.05, betas=(0.9, 0.98))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, _READING_RATE, total_steps=max(1, steps))
    for step in range(steps):
        some = known[torch.randint(len(known), (_SENTENCES,))]
        loss = 1 - (embed(some) * wanted[some]).sum(1).mean()
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(learned, 1.0)
        optimiser.step()
        schedule.step()
        if step % 100 == 0 or step == steps - 1:
            print(f"reading {step}: {float(loss.detach()):.4f}", flush=True)
    with torch.no_grad():
        found = embed(torch.arange(len(every)))
    for name, which in (("known", ~aside), ("kept aside", aside)) if steps else ():
        like = (found[which] * wanted[which]).sum(1)
        right = (found[which] @ wanted.unique(dim=0).T).amax(1) <= like + 1e-6
        print(f"sentences {name}: likeness to their place {float(like.mean()):.3f}, at least {float(like.min()):.3f}; "
              f"{float(right.float().mean()):.1%} are nearest to it", flush=True)  # fmt: skip
    return {every[at]: found[at] for at in known.tolist()}


def train(folder: Path, steps: int, seed: int, rate: float, begin: Path | None) -> None:
    """Trains the network and saves it in a folder.

    begin: folder of a network that can read, and goes on learning to see
    """
    from transformers import AutoTokenizer, CLIPModel

    write_tokenizer(folder)
    started = time.process_time()
    model = make_model(seed) if begin is None else CLIPModel.from_pretrained(
        begin, attn_implementation="eager", dtype=torch.float32)  # fmt: skip
    model.train()
    meant = learn_to_read(model, AutoTokenizer.from_pretrained(folder), seed, _READING if begin is None else 0)
    learned = [*model.vision_model.parameters(), *model.visual_projection.parameters(), model.logit_scale]
    optimiser = torch.optim.AdamW(learned, rate, weight_decay=0.01, betas=(0.9, 0.98))
    chance, order = torch.Generator().manual_seed(seed), random.Random(seed)
    views = Views(64, SIDE, seed, wholes=44)
    lessons: list[Lesson] = []
    queue: list[tuple[Lesson, int]] = []
    for step in range(steps):
        done = step / steps
        for group in optimiser.param_groups:
            group["lr"] = rate * min(1, (step + 1) / 60) * (0.02 + 0.98 * 0.5 * (1 + math.cos(math.pi * done)))
        if len(queue) < _GROUPS:
            lessons = [*lessons[-_LESSONS + 1 :], Lesson(_LESSON, order.randrange(2**31))]
            queue = [(lesson, at) for lesson in lessons for at in range(len(lesson.pairs))]
            order.shuffle(queue)
        now, queue = queue[:_GROUPS], queue[_GROUPS:]
        drawn = torch.cat([lesson.seen[3 * at : 3 * at + 3] for lesson, at in now]).float()
        said = [picture for lesson, at in now for picture in lesson.pairs[at]]
        extra = [other for other in (world.change_word(picture, order) for picture in said) if other in meant]
        looks = views.some(12, chance)
        looks = looks[torch.randint(12, (len(drawn),), generator=chance)]
        drawn = torch.cat([views.of(one, look[None]) for one, look in zip(drawn, looks, strict=True)])
        words = torch.stack([meant[picture] for picture in (*said, *extra)])
        shown = torch.arange(len(drawn)).reshape(-1, 3)[:, :2].flatten()  # the picture of each sentence
        every = [picture.set_upright() for picture in (*said, *extra)]
        same = torch.tensor([[one == other for other in every] for one in every[: len(said)]])
        mine = torch.arange(len(shown))
        same[mine, mine] = False
        scale = model.logit_scale.exp().clamp(max=60)

        # Likeness and contrast, of pictures as they are (half) and a little disturbed.
        seen = drawn + 0.05 * torch.randn(len(drawn), 3, 1, 1, generator=chance)
        light = torch.rand(len(drawn), 1, 1, 1, generator=chance) < 0.5
        seen = torch.where(light, seen, seen + 0.35 * (disturb(drawn, chance) - drawn)).clamp(0, 1)
        found = functional.normalize(model.get_image_features((seen - _MEAN) / _SPREAD).pooler_output, dim=1)
        like = (found[shown] * words[: len(said)]).sum(1)
        table = scale * found @ words.T  # [pictures, sentences]
        rows = table[shown].masked_fill(same, -1e4)
        over = torch.zeros(len(drawn), len(shown), dtype=torch.bool)
        over[shown] = same[:, : len(shown)]
        columns = table[:, : len(shown)].masked_fill(over, -1e4).T
        contrast = functional.cross_entropy(rows, mine) + functional.cross_entropy(columns, shown)
        right = (rows.argmax(1) == mine).float().mean()

        # Denoising, of each sentence at its disturbed picture: half of these have been moved by the eye itself.
        denoised = torch.zeros(())
        if done >= _FROM or begin is not None:
            clean = drawn[shown]
            away, half = disturb(clean, chance), len(shown) // 2
            away[:half] = _climb(model, away[:half], words[:half], chance)
            slope = _follow(model, away.requires_grad_(), words[: len(said)], create_graph=True)
            denoised = _differ(slope, (clean - away).detach())

        loss = contrast + _LIKE * (1 - like.mean()) + _PULL * denoised
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(learned, 1.0)
        optimiser.step()
        if step % 20 == 0:
            print(f"{step} {time.process_time() - started:.0f} s: contrast {float(contrast.detach()):.3f}, like "
                  f"{float(like.detach().mean()):.3f}, denoised {float(denoised.detach()):.3f}, right "
                  f"{float(right):.2f}, scale {float(scale.detach()):.0f}", flush=True)  # fmt: skip
        if step % 100 == 99:
            model.save_pretrained(folder)
    model.half().save_pretrained(folder)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=3000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--begin", type=Path, help="folder of a network to go on with")
    given = parser.parse_args()
    torch.set_num_threads(1)
    train(given.folder, given.steps, given.seed, given.rate, given.begin)
