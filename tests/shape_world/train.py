"""Training of the eye that reads and sees the small world: a CLIP of `transformers`, saved as an ordinary folder.

    PYTHONPATH=src:tests python -m shape_world.train FOLDER [--steps 1000] [--seed 1]

Two losses at once. Contrast: pictures and sentences find each other, among neighbours that differ in one word and
pictures that blobs have spoiled. Denoising: the gradient of a likeness, at a picture that was disturbed, points to the
picture itself. So an optimiser that follows the likeness paints the picture, and no pattern that only fools the eye;
compare denoising score matching (Vincent, "A connection between score matching and denoising autoencoders", 2011).
"""

import argparse
import json
import math
import random
import time
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn import functional

from frida_painter.objectives.semantic_loss import Views
from shape_world import world
from shape_world.world import COLOR_NAMES, DRAWN, PLACES, Picture

SIDE, PATCH = 24, 8  # pixels of the eye's picture and of a patch: too coarse for fine patterns
_DRAWN = SIDE * 5 // 4  # side of a drawing; `Views` looks at it
_GROUPS = 20  # of a batch; a group is a picture, a neighbour, and the picture spoiled by a blob
_LESSON, _LESSONS = 600, 6  # groups of a lesson, and lessons: each is drawn once and seen several times
_MEAN = torch.tensor([0.48145466, 0.4578275, 0.40821073])[:, None, None]
_SPREAD = torch.tensor([0.26862954, 0.26130258, 0.27577711])[:, None, None]
_HEADS = {"count": 4, "ground": len(COLOR_NAMES), "axis": 3, "place": 1 + len(PLACES),
          "color": len(COLOR_NAMES), "shape": len(DRAWN), "color2": len(COLOR_NAMES), "shape2": len(DRAWN)}  # fmt: skip
_NONE = -100  # no label: the loss leaves it out
_LEVELS = {1: 0.25, 3: 0.3, 6: 0.3, 12: 0.25, SIDE: 0.12}  # cells of a side, and standard deviation of their noise
_PULL = 8.0  # weight of denoising
_FROM = 0.15  # share of the steps without it: words must be known first


def _label(picture: Picture, *, is_spoiled: bool) -> list[int]:
    """Returns what a picture shows, one label of each head. Of a spoiled one only the ground is told."""
    ground = COLOR_NAMES.index(picture.ground)
    if is_spoiled:
        return [_NONE, ground, *[_NONE] * 6]
    upright = picture.set_upright()
    first, second = upright.thing, upright.other or upright.thing
    return [
        3 if picture.other else picture.count - 1, ground, ("", "left of", "above").index(upright.relation),
        ("", *PLACES).index(picture.place), COLOR_NAMES.index(first.color), DRAWN.index(first.shape),
        COLOR_NAMES.index(second.color), DRAWN.index(second.shape),
    ]  # fmt: skip


class Lesson:
    """Groups of drawings, each a picture, a neighbour and the first spoiled; with their labels."""

    def __init__(self, groups: int, seed: int) -> None:
        chance = random.Random(seed)
        self.pairs: list[tuple[Picture, Picture]] = []
        while len(self.pairs) < groups:
            one = world.choose_picture(chance)
            if one.count == 1 and one.other is None and chance.random() < 0.6:
                continue  # single things are learned sooner than several
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
        self.facts = torch.tensor([_label(picture, is_spoiled=spoils) for picture, spoils in shown])


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


def train(folder: Path, steps: int, seed: int, begin: Path | None, rate: float) -> None:
    """Trains the network and saves it in a folder."""
    from transformers import AutoTokenizer, CLIPModel

    write_tokenizer(folder)
    tokenizer = AutoTokenizer.from_pretrained(folder)
    started = time.process_time()
    model = make_model(seed) if begin is None else CLIPModel.from_pretrained(
        begin, attn_implementation="eager", dtype=torch.float32)  # fmt: skip
    model.train()
    heads = nn.Linear(model.config.projection_dim, sum(_HEADS.values()))  # the same for both towers
    learned = [*model.parameters(), *heads.parameters()]
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
            if len(lessons) < _LESSONS:
                lessons.append(Lesson(_LESSON, order.randrange(2**31)))
            queue = [(lesson, at) for lesson in lessons for at in range(len(lesson.pairs))]
            order.shuffle(queue)
        now, queue = queue[:_GROUPS], queue[_GROUPS:]
        drawn = torch.cat([lesson.seen[3 * at : 3 * at + 3] for lesson, at in now]).float()
        facts = torch.cat([lesson.facts[3 * at : 3 * at + 3] for lesson, at in now])
        said = [picture for lesson, at in now for picture in lesson.pairs[at]]
        extra = [world.change_word(picture, order) for picture in said]
        looks = views.some(12, chance)
        looks = looks[torch.randint(12, (len(drawn),), generator=chance)]
        drawn = torch.cat([views.of(one, look[None]) for one, look in zip(drawn, looks, strict=True)])
        tokens = tokenizer([one.say() for one in (*said, *extra)], padding=True, return_tensors="pt")
        words = functional.normalize(model.get_text_features(**tokens).pooler_output, dim=1)
        shown = torch.arange(len(drawn)).reshape(-1, 3)[:, :2].flatten()  # the picture of each sentence
        every = [picture.set_upright() for picture in (*said, *extra)]
        same = torch.tensor([[one == other for other in every] for one in every[: len(said)]])
        mine = torch.arange(len(shown))
        same[mine, mine] = False
        scale = model.logit_scale.exp().clamp(max=60)

        # Contrast, of pictures as they are (half) and a little disturbed.
        seen = drawn + 0.05 * torch.randn(len(drawn), 3, 1, 1, generator=chance)
        light = torch.rand(len(drawn), 1, 1, 1, generator=chance) < 0.5
        seen = torch.where(light, seen, seen + 0.35 * (disturb(drawn, chance) - drawn)).clamp(0, 1)
        pooled = model.vision_model((seen - _MEAN) / _SPREAD).pooler_output
        found = functional.normalize(model.visual_projection(pooled), dim=1)
        table = scale * found @ words.T  # [pictures, sentences]
        rows = table[shown].masked_fill(same, -1e4)
        over = torch.zeros(len(drawn), len(shown), dtype=torch.bool)
        over[shown] = same[:, : len(shown)]
        columns = table[:, : len(shown)].masked_fill(over, -1e4).T
        contrast = functional.cross_entropy(rows, mine) + functional.cross_entropy(columns, shown)
        told = sum(
            functional.cross_entropy(part, labels[:, at], ignore_index=_NONE)
            for both, labels in ((found, facts), (words[: len(said)], facts[shown]))
            for at, part in enumerate(heads(10 * both).split(list(_HEADS.values()), 1))
        )
        right = (rows.argmax(1) == mine).float().mean()

        # Denoising, of each sentence at its disturbed picture: half of these have been moved by the eye itself.
        denoised = torch.zeros(())
        if done >= _FROM or begin is not None:
            clean = drawn[shown]
            away, half = disturb(clean, chance), len(shown) // 2
            away[:half] = _climb(model, away[:half], words[:half].detach(), chance)
            slope = _follow(model, away.requires_grad_(), words[: len(said)], create_graph=True)
            denoised = _differ(slope, (clean - away).detach())

        loss = contrast + _PULL * denoised + 0.5 * (1 - done) * told
        optimiser.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(learned, 1.0)
        optimiser.step()
        if step % 20 == 0:
            print(f"{step} {time.process_time() - started:.0f} s: contrast {float(contrast.detach()):.3f}, told "
                  f"{float(told.detach()):.2f}, denoised {float(denoised.detach()):.3f}, right {float(right):.2f}, "
                  f"scale {float(scale.detach()):.0f}", flush=True)  # fmt: skip
        if step % 100 == 99:
            model.save_pretrained(folder)
    model.half().save_pretrained(folder)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--steps", type=int, default=2500)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--begin", type=Path, help="folder of a network to begin with")
    given = parser.parse_args()
    torch.set_num_threads(1)
    train(given.folder, given.steps, given.seed, given.begin, given.rate)
