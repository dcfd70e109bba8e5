"""What a sweep file means, and what is said of one that means nothing."""

from pathlib import Path

import pytest

from frida_painter.errors import ConfigError
from frida_painter.runs.spec import FILES
from frida_painter_lab.sweeps.sweep_spec import SweepRun, SweepSpec, label, run_spec

GRID = {"image": ["a.jpg", "b.jpg"], "seed": [0, 1, 2]}


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "my-sweep.toml"
    path.write_text(text)
    return path


def runs(**values) -> list[SweepRun]:
    return [SweepRun.of(values.get("kind", "plan"), *fields, hash_of=str) for fields in SweepSpec.of(**values).fields()]


def test_a_grid_makes_every_combination() -> None:
    made = runs(grid=GRID, settings={"strokes": 50})
    assert [tuple(run.labels.values()) for run in made] == [(p, s) for p in ("a.jpg", "b.jpg") for s in range(3)]
    assert {run.spec.strokes for run in made} == {50}
    assert made[4].spec.seed == 1 and made[4].spec.goal[0].value == "b.jpg"
    assert SweepSpec.of(grid=GRID).count == 6 and SweepSpec.of(grid=GRID).axes == ("image", "seed")


def test_a_list_makes_its_runs_with_every_combination() -> None:
    made = runs(
        settings={"text": "a lemon"}, runs=[{"strokes": 5}, {"strokes": 9, "brush": "fine"}], grid={"seed": [1, 2]}
    )
    assert [(run.spec.strokes, run.spec.brushes, run.spec.seed) for run in made] == [
        (5, None, 1), (5, None, 2), (9, "fine", 1), (9, "fine", 2),
    ]  # fmt: skip
    assert dict(made[3].labels) == {"seed": 2, "strokes": 9, "brush": "fine"}


def test_what_decides_the_outcome_decides_the_key() -> None:
    first, *others = (
        runs(settings={"image": "a.jpg", **changed})[0]
        for changed in ({}, {"seed": 1}, {"strokes": 20}, {"effort": 0.5}, {"image": "b.jpg"}, {"text": "a lemon"})
    )
    assert len({first.key, *(run.key for run in others)}) == 6
    again = runs(settings={"image": "a.jpg"}, grid={"seed": [0]})[0]
    assert again.key == first.key and again.labels != first.labels
    (painted,) = runs(settings={"image": "a.jpg"}, kind="painting")
    assert painted.key != first.key

    def by_content(path: Path) -> str:
        return "the same content"

    fields = [{}, {"image": "moved/a.jpg"}], [{}, {"image": "a.jpg"}]
    assert len({SweepRun.of("plan", *both, hash_of=by_content).key for both in fields}) == 1


def test_the_content_of_every_file_decides_the_key() -> None:
    for name in set(FILES):
        fields = {"image": "a.jpg", "colors": 4, name: "kept.file"}
        keys = [SweepRun.of("plan", {}, fields, hash_of=lambda path, n=n: f"{path.name} {n}").key for n in (1, 1, 2)]
        assert keys[0] == keys[1] != keys[2], name


def test_settings_make_the_same_description_again() -> None:
    goal = [{"image": "a.jpg", "weight": 2}, {"text": "a lemon"}]
    fields = {"goal": goal, "strokes": 7, "canvas": "20x10cm", "initial": [{"style": "c.jpg"}]}
    made = SweepRun.of("plan", {}, fields, hash_of=str)
    assert made.spec == run_spec(fields)
    assert made.files == {"a.jpg": "a.jpg", "c.jpg": "c.jpg"}


def test_a_file_names_others_beside_it(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    for name in ("b.jpg", "a.jpg", "note.txt"):
        (tmp_path / "photos" / name).touch()
    spec = SweepSpec.from_toml(
        written(
            tmp_path, 'kind = "painting"\n[settings]\npalette = "p.json"\n[grid]\nimage = ["photos/*.jpg", "c.jpg"]\n'
        )
    )
    assert spec.title == "my sweep" and spec.kind == "painting"
    assert spec.settings["palette"] == str(tmp_path / "p.json")
    names = [str(tmp_path / name) for name in ("photos/a.jpg", "photos/b.jpg", "c.jpg")]
    assert spec.grid["image"] == names
    deep = SweepSpec.from_toml(written(tmp_path, '[grid]\ngoal = [[{image = "a.jpg"}], [{text = "a/b"}]]\n'))
    assert deep.grid["goal"] == [[{"image": str(tmp_path / "a.jpg")}], [{"text": "a/b"}]]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[grid]\nseeds = [0]", "'seeds' is not a field of a run; there are avoid"),
        ("[settings]\nplan = 'a.json'", "'plan' is not a field of a run"),
        ("[grid]\nseed = []", "seed has no values; give at least one"),
        ("[grid]\nimage = ['nothing/*.jpg']", "No file is called nothing/*.jpg (in "),
        ("runs = []", "there are no runs"),
        ("[grid]\nseed = [0]\n[[runs]]\nseed = 1", "seed stands in the grid and in"),
        ("tries = nan", "tries was given nan"),
        ("time_limit = nan", "time_limit was given nan; it should be a finite number."),
        ("time_limit = -1", "time_limit was given -1"),
        ("threads = 0", "threads was given 0"),
        ("threads = 2.5", "threads was given 2.5"),
        ("grid = 3", "grid was given 3; it should be a valid dictionary."),
        ("grid.seed = 3", "grid.seed was given 3; it should be a valid list."),
        ("runs = [3]", "runs.0 was given 3; it should be a valid dictionary."),
        ("sweeps = 3", "'sweeps' is unknown; there are version, title"),
        ("kind = 'dance'", "kind was given 'dance'"),
        ("= 3", "is not TOML"),
        ("version = 2", "version was given 2"),
    ],
)
def test_a_file_that_makes_no_sweep_is_refused_in_one_sentence(tmp_path: Path, text: str, says: str) -> None:
    with pytest.raises(ConfigError) as refused:
        SweepSpec.from_toml(written(tmp_path, text))
    assert says in str(refused.value) and "\n" not in str(refused.value).removesuffix("\n")


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"settings": {"image": "a.jpg", "effort": float("nan")}}, "--effort was given nan"),
        ({"settings": {"image": "a.jpg", "strokes": 0}}, "--strokes was given 0"),
        ({"settings": {"strokes": 5}}, "nothing to paint"),
        ({"settings": {"image": "a.jpg"}, "kind": "evaluation"}, "plan = FILE"),
        ({"settings": {"image": "a.jpg", "robot": "human"}, "kind": "painting"}, "--robot human is a real one"),
    ],
)
def test_a_run_that_cannot_be_is_refused(values: dict, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        runs(**values)


def test_labels_are_short() -> None:
    assert label("/somewhere/cat.jpg") == "cat.jpg" and label(0.5) == 0.5 and label(None) is None
    assert label([{"image": "/x/cat.jpg", "weight": 1}, {"text": "a lemon", "weight": 2}]) == (
        "image cat.jpg + text a lemon, weight 2"
    )
