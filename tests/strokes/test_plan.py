import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from frida_painter.errors import PlanError
from frida_painter.strokes.palette import Palette
from frida_painter.strokes.plan import Layer, Plan
from frida_painter.strokes.strokes import GROUPS
from frida_painter.system import storage
from support.belongings import files_of_a_person, require_untouched
from support.plans import CANVAS, LIMITS, in_layers, made_up_plan


def edited(path: Path, **changes: object) -> None:
    """Changes a plan file as somebody would who also mends its checksum."""
    record = json.loads(path.read_text())
    storage.write_json(path, {**record, **changes})


def two_layers(*sizes: object, **changes: object) -> list[dict[str, object]]:
    """The layers of a plan's file."""
    known: dict[str, object] = {"brush": "medium", "paints": [0, 5]}
    limits = {"length_m": list(LIMITS.length), "bend_m": list(LIMITS.bend)}
    return [{"strokes": size, **known, **limits, **changes} for size in sizes]


def test_a_plan_comes_back_as_it_was(tmp_path: Path) -> None:
    plan = made_up_plan()
    plan.part(slice(0)).save(tmp_path / "none.json")
    assert len(Plan.load(tmp_path / "none.json")) == 0
    plan.save(tmp_path / "plan.json")
    for path in (tmp_path / "plan.json", tmp_path):
        loaded = Plan.load(path)
        assert all(torch.equal(getattr(loaded.strokes, name), getattr(plan.strokes, name)) for name in GROUPS)
        assert torch.equal(loaded.paint, plan.paint) and torch.equal(loaded.palette.color, plan.palette.color)
        assert (loaded.canvas, loaded.about) == (CANVAS, (("seed", "0"),))
        assert loaded.layers == (Layer(40, "medium", LIMITS, (0, 5)),)
        assert loaded.digest == plan.digest


def test_a_crash_between_the_two_files_leaves_the_plan_that_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made_up_plan(seed=1).save(tmp_path / "plan.json")
    monkeypatch.setattr(storage, "write_json", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        made_up_plan(seed=2).save(tmp_path / "plan.json")
    assert Plan.load(tmp_path).digest == made_up_plan(seed=1).digest


def test_the_digest_follows_everything_that_is_painted() -> None:
    plan = made_up_plan()
    strokes = plan.strokes.with_groups(bend=plan.strokes.bend * 0.999)
    others = (
        replace(plan, strokes=strokes),
        replace(plan, layers=(replace(plan.layers[0], brush="fine"),)),
        replace(plan, ground=(0.9, 0.9, 0.9)),
        replace(plan, canvas=replace(CANVAS, width=0.31)),
        plan.part(slice(0, 39)),
        in_layers(plan, 30, 10),
    )
    assert len({plan.digest, *(other.digest for other in others)}) == len(others) + 1
    assert replace(plan, about=()).digest == plan.digest


def test_a_part_of_a_plan() -> None:
    plan = made_up_plan()
    part = plan.part(slice(10, 15))
    assert len(part) == 5 and torch.equal(part.strokes.length, plan.strokes.length[10:15])
    assert torch.equal(part.paint, plan.paint[10:15]) and part.palette is plan.palette


@pytest.mark.parametrize("painted", [0, 12, 30, 33, 40])
def test_what_was_painted_and_the_rest_are_the_plan_with_its_layers(painted: int) -> None:
    plan = in_layers(made_up_plan(), 30, 10)
    done, rest = plan.part(slice(painted)), plan.part(slice(painted, None))
    assert len(done.layers) == len(rest.layers) == 2
    assert done.followed_by(rest).digest == plan.digest
    assert plan.layer_end(painted) == (30 if painted < 30 else 40)
    parts = rest.by_layer()
    assert [len(part) for part in parts] == [max(0, 30 - painted), 40 - max(30, painted)]
    first, second = parts
    assert first.under(second).layers == rest.layers


def of_two_brushes() -> Plan:
    """30 strokes of one brush in five paints, and 10 of another in three that are mixed for them."""
    first, second = made_up_plan(30), made_up_plan(10, 3, seed=7)
    return first.under(replace(second, layers=(replace(second.layers[0], brush="fine"),)))


def test_each_layer_has_its_brush_and_its_paints(tmp_path: Path) -> None:
    plan, (first, second) = of_two_brushes(), (made_up_plan(30), made_up_plan(10, 3, seed=7))
    plan.save(tmp_path / "plan.json")
    loaded = Plan.load(tmp_path)
    assert loaded.layers == plan.layers and loaded.digest == plan.digest
    assert plan.brushes == ("medium", "fine") and [layer.paints for layer in plan.layers] == [(0, 5), (5, 8)]
    for part, own in zip(loaded.by_layer(), (first, second), strict=True):
        assert torch.equal(part.palette.color, own.palette.color) and torch.equal(part.paint, own.paint)
    assert torch.equal(plan.well, torch.cat([first.paint, second.paint]))
    assert [(number, len(part)) for number, part in plan.by_wells()] == [(1, 30), (2, 10)]
    fine = replace(plan, layers=tuple(replace(layer, brush="medium") for layer in plan.layers))
    assert len({plan.digest, fine.digest, in_layers(made_up_plan(), 30, 10).digest}) == 3


def darkened(layer: Plan) -> Plan:
    """A layer in other paints."""
    palette = Palette(layer.palette.color * 0.5)
    return replace(layer, palette=palette, strokes=layer.strokes.with_groups(color=palette.color[layer.paint]))


@pytest.mark.parametrize("painted", [0, 12, 30])
def test_a_layer_that_was_not_begun_may_get_other_paints(painted: int) -> None:
    plan = of_two_brushes()
    done, rest = plan.part(slice(painted)), plan.part(slice(painted, None))
    *lower, last = rest.filled_layers()
    whole = done.followed_by(rest.with_parts([*lower, darkened(last)]))
    assert torch.equal(whole.palette.color[5:], last.palette.color * 0.5)
    assert torch.equal(whole.palette.color[:5], plan.palette.color[:5])
    assert torch.equal(whole.strokes.position, plan.strokes.position)


def test_a_layer_that_is_half_painted_keeps_its_paints() -> None:
    plan = of_two_brushes()
    done, rest = plan.part(slice(33)), plan.part(slice(33, None))
    with pytest.raises(PlanError, match="not that of its paint"):
        done.followed_by(rest.with_parts([darkened(rest.filled_layers()[0])]))


@pytest.mark.parametrize(
    ("paints", "says"),
    [
        ([(0, 5), (4, 8)], "each paint belongs to"),
        ([(0, 5), (5, 7)], "each paint belongs to"),
        ([(0, 5), (0, 5)], "each paint belongs to"),
        ([(5, 8), (0, 5)], "not in its wells"),
        ([(0, 0), (0, 8)], "each paint belongs to"),
    ],
)
def test_wells_that_do_not_fit_are_refused(paints: list[tuple[int, int]], says: str) -> None:
    plan = of_two_brushes()
    layers = tuple(replace(layer, paints=of) for layer, of in zip(plan.layers, paints, strict=True))
    with pytest.raises(PlanError, match=says):
        replace(plan, layers=layers)


def test_layers_that_are_not_those_of_the_strokes_are_refused() -> None:
    plan = made_up_plan()
    for layers in ((39,), (41, -1), (20, 20, 20)):
        with pytest.raises(PlanError, match="A plan of 40 strokes has layers"):
            in_layers(plan, *layers)
    layered = in_layers(plan, 20, 20)
    with pytest.raises(PlanError, match="mixes the layers"):
        layered.reorder(torch.arange(40).flip(0))
    with pytest.raises(PlanError, match="2 layers was to be followed by one of 1"):
        layered.followed_by(plan)


def test_parts_that_do_not_fit_are_refused() -> None:
    plan = made_up_plan()
    for changes, says in (
        ({"paint": plan.paint[1:]}, "40 strokes and 39 paint numbers"),
        ({"paint": plan.paint + 1}, "outside its palette of 5"),
        ({"paint": plan.paint - 1}, "outside its palette"),
        ({"strokes": plan.strokes.with_groups(color=plan.strokes.color * 0.5)}, "not that of its paint"),
        ({"strokes": plan.strokes.with_groups(length=plan.strokes.length + 1)}, "Stroke 0 has length"),
    ):
        with pytest.raises(PlanError, match=says):
            replace(plan, **changes)  # type: ignore[arg-type]


def test_a_plan_cut_in_half_or_edited_is_refused(tmp_path: Path) -> None:
    made_up_plan().save(tmp_path / "plan.json")
    whole = (tmp_path / "plan.json").read_text()
    beside = next(tmp_path.glob("*.safetensors"))
    for content in (whole[: len(whole) // 2], whole.replace('"strokes": 40', '"strokes": 41'), "", "{}"):
        (tmp_path / "plan.json").write_text(content)
        with pytest.raises(PlanError, match=r"plan\.json"):
            Plan.load(tmp_path)
    (tmp_path / "plan.json").write_text(whole)
    beside.write_bytes(beside.read_bytes()[:-100])
    with pytest.raises(PlanError, match="sha256 differs"):
        Plan.load(tmp_path)
    beside.unlink()
    with pytest.raises(PlanError, match="does not exist"):
        Plan.load(tmp_path)


def test_a_plan_that_is_saved_again_costs_nobody_a_file(tmp_path: Path) -> None:
    own = files_of_a_person(tmp_path)
    plan = made_up_plan()
    plan.save(tmp_path / "cat.json")
    (tmp_path / "cat-3.json").write_bytes((tmp_path / "cat.json").read_bytes())
    plan.edit(angle=0.0).save(tmp_path / "cat.json")
    plan.edit(angle=0.1).save(tmp_path / "cat.json")
    require_untouched(own)
    assert Plan.load(tmp_path / "cat-3.json").digest == plan.digest != Plan.load(tmp_path / "cat.json").digest


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format": "something else"}, "is not a plan"),
        ({"version": 99}, "of version 99"),
        ({"strokes": 10_000_000}, "at most 100000"),
        ({"strokes": "many"}, "missing or out of range"),
        ({"canvas_m": [100.0, 100.0]}, "missing or out of range"),
        ({"canvas_m": [0.3]}, "missing or out of range"),
        ({"canvas_m": [0.05, 0.05]}, "Stroke"),
        ({"layers": [{"strokes": 40}]}, "missing or out of range"),
        ({"about": []}, "missing or out of range"),
        ({"tensors": "../../etc/passwd"}, "passwd does not exist"),
        ({"tensors": None}, "missing or out of range"),
        ({"layers": two_layers(30, 11)}, "has layers of 30, 11"),
        ({"version": 2}, "of version 2; .* reads versions 3 and 4; .* plan anew"),
        ({"version": 5}, "is a plan in which the brush leans.*plan anew"),
        ({"layers": []}, "missing or out of range"),
        ({"layers": ["40"]}, "missing or out of range"),
        ({"layers": two_layers("20", 20)}, "missing or out of range"),
        ({"layers": two_layers(20, 20, brush=3)}, "missing or out of range"),
        ({"layers": two_layers(20, 20, paints=[0])}, "missing or out of range"),
        ({"layers": two_layers(20, 20, paints=[0, 2])}, "each paint belongs to"),
        ({"layers": two_layers(20, 20)}, "does not belong to the strokes"),
        ({"layers": two_layers(40, 0, brush="other")}, "does not belong to the strokes"),
        ({"digest": "0" * 64}, "does not belong to the strokes"),
    ],
)
def test_a_plan_edited_with_its_checksum_mended_is_refused(
    tmp_path: Path, changes: dict[str, object], says: str
) -> None:
    made_up_plan().save(tmp_path / "plan.json")
    edited(tmp_path / "plan.json", **changes)
    with pytest.raises(PlanError, match=says):
        Plan.load(tmp_path)


def test_strokes_of_another_plan_are_refused(tmp_path: Path) -> None:
    made_up_plan(seed=1).save(tmp_path / "a" / "plan.json")
    made_up_plan(seed=2).save(tmp_path / "b" / "plan.json")
    mine, other = (next((tmp_path / folder).glob("*.safetensors")) for folder in "ab")
    shutil.copy(other, mine)
    with pytest.raises(PlanError, match="sha256 differs"):
        Plan.load(tmp_path / "a")


def test_what_is_not_there_is_said(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "plan.json"):
        with pytest.raises(PlanError, match=r"plan\.json does not exist; give the path of a plan"):
            Plan.load(path)


def test_strokes_take_another_order_with_their_paints() -> None:
    plan = made_up_plan(6, 3)
    order = torch.tensor([5, 0, 1, 4, 3, 2])
    other = plan.reorder(order)
    assert torch.equal(other.strokes.position, plan.strokes.position[order])
    assert torch.equal(other.paint, plan.paint[order])
    for wrong in ([0, 1, 2, 3, 4], [0, 1, 2, 3, 4, 4], [0, 1, 2, 3, 4, 6]):
        with pytest.raises(PlanError, match="names each of 6 strokes once"):
            plan.reorder(torch.tensor(wrong))
