import errno
import json
import os
import socket
from pathlib import Path
from typing import NoReturn

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError, PlanError, StorageError
from frida_painter.system import storage
from support.belongings import files_of_a_person, require_untouched

RECORDS = st.dictionaries(
    st.text(max_size=8).filter(lambda key: key != "sha256"),
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**60), 2**60) | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(max_size=8),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
        max_leaves=8,
    ),
    max_size=5,
)  # fmt: skip


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "new" / "a.txt", "first")
    storage.write_text(tmp_path / "new" / "a.txt", "zweite Fassung, größer")
    assert (tmp_path / "new" / "a.txt").read_text(encoding="utf-8") == "zweite Fassung, größer"
    assert names(tmp_path / "new") == ["a.txt"]
    assert (tmp_path / "new" / "a.txt").stat().st_mode & 0o777 == 0o644


def test_an_interrupted_write_leaves_what_was_there(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "a.txt", "old")
    with pytest.raises(KeyboardInterrupt), storage.replacing(tmp_path / "a.txt") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert (tmp_path / "a.txt").read_text() == "old" and names(tmp_path) == ["a.txt"]


def test_a_full_disk_leaves_what_was_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(_: int) -> NoReturn:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    storage.write_text(tmp_path / "a.txt", "old")
    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(StorageError, match="No space left on device"):
        storage.write_text(tmp_path / "a.txt", "new")
    assert (tmp_path / "a.txt").read_text() == "old" and names(tmp_path) == ["a.txt"]


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(StorageError, match=r"file/a\.txt cannot be written"):
        storage.write_text(tmp_path / "file" / "a.txt", "text")


@given(record=RECORDS)
def test_json_comes_back_as_it_was(tmp_path_factory: pytest.TempPathFactory, record: dict[str, object]) -> None:
    path = tmp_path_factory.getbasetemp() / "record.json"
    storage.write_json(path, record)
    assert storage.read_json(path, "a record") == record


def test_numbers_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    for value in (float("nan"), float("inf")):
        with pytest.raises(ValueError, match="Out of range"):
            storage.write_json(tmp_path / "a.json", {"value": [value]})
    assert names(tmp_path) == []


@given(share=st.floats(0, 1, exclude_max=True))
def test_a_file_cut_off_anywhere_is_refused(tmp_path_factory: pytest.TempPathFactory, share: float) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.json"
    storage.write_json(path, {"format": "test", "values": [1.5, 2.5], "name": "größer"})
    content = path.read_bytes().rstrip()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(PlanError, match=r"cut\.json"):
        storage.read_json(path, "a plan", PlanError)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ('{"a": 1}', "no checksum"),
        ("[1, 2]", "no checksum"),
        ('{"a": 1, "a": 2, "sha256": ""}', "twice"),
        ('{"a": NaN, "sha256": ""}', "NaN"),
        ('{"a": -Infinity, "sha256": ""}', "Infinity"),
        ('{"a": 1e999, "sha256": ""}', "is not a number"),
        ("[" * 100_000, "cut off or not JSON"),
        ("\udcff", "cut off or not JSON"),
    ],
)
def test_what_nobody_here_wrote_is_refused(tmp_path: Path, content: str, says: str) -> None:
    (tmp_path / "a.json").write_bytes(content.encode("utf-8", "surrogateescape"))
    with pytest.raises(StorageError, match=says):
        storage.read_json(tmp_path / "a.json", "a record")


def test_an_edited_record_is_refused(tmp_path: Path) -> None:
    storage.write_json(tmp_path / "a.json", {"width": 0.3, "name": "x"})
    record = json.loads((tmp_path / "a.json").read_text())
    (tmp_path / "a.json").write_text(json.dumps({**record, "width": 0.4}))
    with pytest.raises(StorageError, match="was changed after it was written"):
        storage.read_json(tmp_path / "a.json", "a record")
    (tmp_path / "a.json").write_text(json.dumps(record))  # other spacing is no other content
    assert storage.read_json(tmp_path / "a.json", "a record")["width"] == 0.3


def test_missing_folder_and_too_large(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="does not exist; give the path of a record"):
        storage.read_bytes(tmp_path / "a", "a record", 10)
    with pytest.raises(StorageError, match="is a folder; give the path of a record"):
        storage.read_bytes(tmp_path, "a record", 10**6)
    (tmp_path / "a").write_bytes(b"12345678901")
    with pytest.raises(StorageError, match="11 bytes; a record has at most 10"):
        storage.read_bytes(tmp_path / "a", "a record", 10)


def test_space_is_asked_for_before_work_begins(tmp_path: Path) -> None:
    storage.require_space(tmp_path / "not" / "yet", 1000, "this painting")
    with pytest.raises(StorageError, match=r"MB free; this sweep needs 1099511627776 MB"):
        storage.require_space(tmp_path / "not" / "yet", 2**60, "this sweep")
    assert names(tmp_path) == []


def test_a_new_folder_is_new(tmp_path: Path) -> None:
    storage.new_folder(tmp_path / "a" / "b")
    storage.new_folder(tmp_path / "a" / "b")
    (tmp_path / "a" / "b" / "painting.png").write_text("mine")
    with pytest.raises(StorageError, match="is not empty"):
        storage.new_folder(tmp_path / "a" / "b")
    with pytest.raises(StorageError, match="cannot be written"):
        storage.new_folder(tmp_path / "a" / "b" / "painting.png")
    assert names(tmp_path / "a" / "b") == ["painting.png"]


def test_a_file_is_listed_when_it_is_whole(tmp_path: Path) -> None:
    storage.write_text(tmp_path / "b.json", "{}")
    with storage.replacing(tmp_path / "a.json") as temporary:
        assert temporary in tmp_path.glob("*.json")
        assert storage.list_files(tmp_path, "*.json") == [tmp_path / "b.json"]
    assert storage.list_files(tmp_path, "*.json") == [tmp_path / "a.json", tmp_path / "b.json"]
    assert storage.list_files(tmp_path / "missing", "*.json") == []


def test_what_killed_writes_left_behind_is_cleared_away_and_nothing_else(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), storage.replacing(tmp_path / "film.mp4") as temporary:
        left = [tmp_path / temporary.name, tmp_path / "inner" / temporary.name]
        raise KeyboardInterrupt
    own = [*files_of_a_person(tmp_path), *files_of_a_person(tmp_path / "inner" / "deeper")]
    unread = tmp_path / "inner" / "deeper" / temporary.name  # of a program that writes there
    for path in (*left, unread):
        path.write_text("half a film")
    storage.clear_leftovers(tmp_path, tmp_path / "inner", tmp_path / "missing")
    assert not any(path.exists() for path in left) and unread.exists()
    require_untouched(own)


def test_an_unused_name_is_found_beside_files_and_broken_links(tmp_path: Path) -> None:
    assert storage.find_unused(tmp_path / "a.png") == tmp_path / "a.png"
    (tmp_path / "a.png").touch()
    (tmp_path / "a-2.png").symlink_to("nowhere")
    assert storage.find_unused(tmp_path / "a.png") == tmp_path / "a-3.png"


def what_is_no_file(folder: Path) -> dict[str, Path]:
    """A device, a pipe and a socket, links to them, and names that no file can have."""
    os.mkfifo(folder / "pipe")
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "socket"))
    found = {"a device": Path("/dev/zero"), "a pipe": folder / "pipe", "a socket": folder / "socket"}
    for number, target in enumerate(list(found.values())):
        (folder / f"link-{number}").symlink_to(target)
    links = {f"{what}, by a link": folder / f"link-{number}" for number, what in enumerate(found)}
    return found | links | {"long": folder / ("x" * 5000), "nul": Path("a\0b"), "surrogate": folder / "\udcff/\ud800"}


def test_only_plain_files_are_read_and_nothing_else_is_even_opened(tmp_path: Path) -> None:
    for what, path in what_is_no_file(tmp_path).items():
        with pytest.raises(PlanError) as refusal:
            storage.read_bytes(path, "a plan", 10**6, PlanError)
        said = str(refusal.value)
        assert said.endswith("give the path of a plan.") and len(said) < 400, said
        assert what in ("long", "nul", "surrogate") or f"is not a plain file (but {what.split(',')[0]})" in said
        assert not storage.exists(path) or what not in ("long", "nul", "surrogate")


def test_a_file_that_is_longer_than_it_says_is_not_read_to_its_end() -> None:
    endless = next(Path(f"/proc/self/{name}") for name in ("smaps", "maps") if Path(f"/proc/self/{name}").exists())
    assert endless.stat().st_size == 0
    with pytest.raises(StorageError, match="more than 100 bytes; a record has at most 100"):
        storage.read_bytes(endless, "a record", 100)


def test_neither_a_device_nor_a_pipe_nor_a_folder_is_written_over(tmp_path: Path) -> None:
    for path in (*what_is_no_file(tmp_path).values(), tmp_path):
        with pytest.raises(StorageError, match="cannot be written"):
            storage.require_place(path)
        with pytest.raises(StorageError, match="cannot be written"):
            storage.write_text(path, "mine")
    with pytest.raises(StorageError, match="is not a folder"):
        storage.require_place(Path("/dev/null"), folder=True)
    assert (tmp_path / "pipe").is_fifo()
    storage.require_place(tmp_path / "not" / "yet" / "a.png")
    assert not (tmp_path / "not").exists()


@pytest.mark.parametrize("text", [f"weight = {'9' * 400}", f"a = [{{b = -{'9' * 20}}}]", "a = ", "a = 1\na = 2"])
def test_numbers_that_fit_into_nothing_are_no_toml(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(ConfigError, match=r"is not TOML \(.*\); write lines"):
        storage.read_toml(tmp_path / "a.toml", "a goal file", 10**6, "write lines")


@given(
    st.text(max_size=30)
    | st.sampled_from(["con", "LPT1.txt", "nul .x", "a:b", "end. ", "COM²", "conin$", "console", "a.con"])
)
def test_a_name_of_a_file_is_one_on_windows_as_well(text: str) -> None:
    """As Windows says: none of its signs, no point or space at the end, no device before the first point."""
    name = storage.file_name(text)
    devices = {"con", "prn", "aux", "nul", "conin$", "conout$"} | {
        f"{one}{n}" for one in ("com", "lpt") for n in "0123456789¹²³"
    }
    assert name and not {*name} & {*'<>:"/\\|?*', *map(chr, range(32))} and name[-1] not in ". "
    assert name.split(".")[0].rstrip(" ").lower() not in devices
    assert storage.file_name(name) == name
    if text.isalnum() and text.lower() not in devices:
        assert name == text
