import errno
import os
import re
import resource
import shutil
from collections import namedtuple
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import StorageError
from frida_painter.system.event_log import EventLog, missing
from frida_painter.system.locks import who

RECORDS = [
    {"kind": "began", "stroke": number, "what": "Pinselstrich \N{LATIN SMALL LETTER O WITH DIAERESIS}\n"}
    for number in range(4)
]


def written(path: Path, records: list[dict[str, object]] = RECORDS) -> bytes:
    with EventLog.begin(path, records[0]) as book:
        for record in records[1:]:
            book.append(record)
    return path.read_bytes()


def test_what_was_written_is_read_again_and_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    written(path)
    with EventLog(path) as book:
        assert book.found == RECORDS and book.torn == 0
        book.append({"kind": "ended"})
    assert EventLog.read(path) == [*RECORDS, {"kind": "ended"}]
    assert {item.name for item in tmp_path.iterdir()} == {"journal", ".journal-tally"}, "the reserve is given back"


def test_killed_at_every_byte_of_a_write_the_tail_is_dropped_and_all_before_is_whole(tmp_path: Path) -> None:
    """Fault F3: a process is killed at any byte of a write."""
    path = tmp_path / "journal"
    content = written(path)
    ends = [number for number, byte in enumerate(content, 1) if byte == ord("\n")]
    for length in range(ends[0], len(content) + 1):
        path.write_bytes(content[:length])
        whole = sum(end <= length for end in ends)
        assert EventLog.read(path) == RECORDS[:whole]
        with EventLog(path) as book:
            assert book.found == RECORDS[:whole] and book.torn == length - ends[whole - 1]
            book.append({"kind": "after"})
        assert EventLog.read(path) == [*RECORDS[:whole], {"kind": "after"}]


@pytest.mark.parametrize("rubbish", [b"\0" * 300, b"\xff\xff\n", b"{}\n", b"\n", b"0" * 16 + b" 90 {"])
def test_what_a_power_cut_leaves_in_place_of_a_record_is_dropped(tmp_path: Path, rubbish: bytes) -> None:
    path = tmp_path / "journal"
    path.write_bytes(written(path) + rubbish)
    with EventLog(path) as book:
        assert book.found == RECORDS and book.torn == len(rubbish)


def test_a_power_cut_may_damage_several_records_that_were_not_flushed(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    whole = len(written(path))
    with EventLog(path) as book:
        book.append({"kind": "flushed"})
        flushed = path.stat().st_size
        for number in range(4):
            book.append({"kind": "shown", "number": number}, flush=False)
    content = bytearray(path.read_bytes())
    content[flushed + 5 : flushed + 60] = b"\0" * 55  # a block that never reached the disk; the ones after it did
    path.write_bytes(content)
    assert EventLog.read(path) == [*RECORDS, {"kind": "flushed"}]
    with EventLog(path) as book:
        assert book.found == [*RECORDS, {"kind": "flushed"}] and book.missing == 0 < book.torn
    content[whole + 5] ^= 1  # but what was flushed is never dropped
    path.write_bytes(content)
    with pytest.raises(StorageError, match="was changed"):
        EventLog(path)


def test_a_power_cut_loses_nothing_that_was_told_to_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fault F4: a power cut loses what was not flushed.

    Everything that was not flushed is dropped: the disk holds what it held at the last flush of the file.
    """
    path = tmp_path / "journal"
    safe: list[bytes] = []
    flush = os.fsync

    def note(descriptor: int) -> None:
        flush(descriptor)
        if path.exists() and os.fstat(descriptor).st_ino == path.stat().st_ino:
            safe.append(path.read_bytes())

    monkeypatch.setattr(os, "fsync", note)
    with EventLog.begin(path, RECORDS[0]) as book:
        for number, record in enumerate(RECORDS[1:], 2):
            book.append(record)
            (tmp_path / "after").write_bytes(safe[-1])
            assert EventLog.read(tmp_path / "after") == RECORDS[:number]
    assert all(safe), "never a file without a record"


@given(st.data())
def test_a_changed_byte_is_never_taken_for_what_was_written(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("book") / "journal"
    content = bytearray(written(path))
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    try:
        left = EventLog.read(path)
    except StorageError as error:
        assert "undamaged" in str(error) or "unchanged" in str(error)
    else:
        assert left == RECORDS[:-1], "only the last record may pass for torn"


@pytest.mark.parametrize(
    "change", [lambda lines: lines[:1] + lines[2:], lambda lines: [lines[0], lines[2], lines[1], lines[3]]]
)
def test_records_left_out_or_moved_are_noticed(tmp_path: Path, change: Callable[[list[bytes]], list[bytes]]) -> None:
    path = tmp_path / "journal"
    path.write_bytes(b"".join(change(written(path).splitlines(keepends=True))))
    with pytest.raises(StorageError, match="record 2 is damaged"):
        EventLog(path)


@pytest.mark.parametrize("content", [b"", b"\n", b"notes of a painter\n", b"0" * 16 + b" 2 {}\n"])
def test_a_file_that_is_no_journal_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "journal"
    path.write_bytes(content)
    with pytest.raises(StorageError, match="not a journal"):
        EventLog(path)
    assert path.read_bytes() == content


def test_no_journal_is_made_where_there_is_one_and_none_opened_where_there_is_none(tmp_path: Path) -> None:
    written(tmp_path / "journal")
    with pytest.raises(StorageError, match="never overwritten"):
        EventLog.begin(tmp_path / "journal", {})
    with pytest.raises(StorageError, match="No such file"):
        EventLog(tmp_path / "nothing")


@pytest.mark.parametrize(
    ("reserve", "holder"),
    [
        (None, f"{who()}, in process {os.getpid()}, since 20"),
        ("", "another process"),
        ("\0", "another process"),
    ],
)
def test_only_one_process_writes_and_others_hear_which(tmp_path: Path, reserve: str | None, holder: str) -> None:
    with EventLog.begin(tmp_path / "journal", RECORDS[0]):
        if reserve is not None:
            (tmp_path / ".journal-reserve").write_text(reserve)
        with pytest.raises(StorageError, match=f"is being written by {re.escape(holder)}"):
            EventLog(tmp_path / "journal")
    EventLog(tmp_path / "journal").close()


def test_a_record_that_finds_no_room_is_refused_and_the_next_one_after_room_was_made_is_kept(
    tmp_path: Path,
) -> None:
    """Fault F5: the disk is full in mid-painting.

    A file size limit stops the write midway, as a disk that fills up does.
    """
    path = tmp_path / "journal"
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with EventLog.begin(path, RECORDS[0]) as book:
        before = path.read_bytes()
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) + 20, limits[1]))
        try:
            with pytest.raises(StorageError, match=r"File too large.*resume"):
                book.append(RECORDS[1])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert path.stat().st_size == len(before) + 20, "half a record was written"
        assert EventLog.read(path) == RECORDS[:1]
        book.append(RECORDS[2])
    assert EventLog.read(path) == [RECORDS[0], RECORDS[2]]


def test_on_a_full_disk_the_reserve_is_given_up_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = True
    write = os.pwrite

    def refusing(descriptor: int, content: bytes, place: int) -> int:
        if full and (not roomy or (tmp_path / ".journal-reserve").exists()):
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(descriptor, content, place)

    monkeypatch.setattr(os, "pwrite", refusing)
    with EventLog.begin(tmp_path / "journal", RECORDS[0]) as book:
        roomy = True
        book.append(RECORDS[1])
        assert not (tmp_path / ".journal-reserve").exists()
        roomy = False
        with pytest.raises(StorageError, match="No space left"):
            book.append(RECORDS[2])
        full = False
        book.append(RECORDS[3])
    assert EventLog.read(tmp_path / "journal") == [RECORDS[0], RECORDS[1], RECORDS[3]]


@pytest.mark.parametrize("gone", ["file", "folder"])
def test_a_journal_that_vanished_is_noticed(tmp_path: Path, gone: str) -> None:
    """Fault F7: the painting's folder vanishes or becomes read-only."""
    folder = tmp_path / "painting"
    with EventLog.begin(folder / "journal", RECORDS[0]) as book:
        if gone == "file":
            (folder / "journal").unlink()
        else:
            folder.rename(tmp_path / "elsewhere")
        with pytest.raises(StorageError, match="No such file"):
            book.append(RECORDS[1])
        if gone == "folder":
            (tmp_path / "elsewhere").rename(folder)
            book.append(RECORDS[1])
            assert EventLog.read(folder / "journal") == RECORDS[:2]


def test_numbers_that_are_not_finite_are_not_written(tmp_path: Path) -> None:
    with EventLog.begin(tmp_path / "journal", RECORDS[0]) as book:
        with pytest.raises(ValueError, match="not JSON compliant"):
            book.append({"at": float("nan")})
        assert EventLog.read(tmp_path / "journal") == RECORDS[:1]


def test_lines_that_are_gone_at_the_end_are_counted(tmp_path: Path) -> None:
    """B4: a log that was cut at the end of a line is whole in itself; its tally tells what it held."""
    path = tmp_path / "journal"
    with EventLog.begin(path, RECORDS[0]) as book:
        for record in RECORDS[1:4]:
            book.append(record)
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    assert missing(path, "a journal") == 0
    for kept in range(1, 4):
        path.write_bytes(b"".join(lines[:kept]))
        with EventLog(path) as book:
            assert book.missing == missing(path, "a journal") == 4 - kept
    path.unlink()
    assert missing(path, "a journal") == 4
    path.write_bytes(whole)
    assert missing(path, "a journal") == 0


def test_a_shortened_log_that_was_accepted_is_believed_again(tmp_path: Path) -> None:
    path = tmp_path / "journal"
    with EventLog.begin(path, RECORDS[0]) as book:
        book.append(RECORDS[1])
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])
    with EventLog(path) as book:
        assert book.missing == 1
        book.append(RECORDS[2])
    with EventLog(path) as book:
        assert book.missing == 0


@pytest.mark.parametrize("tally", [b"", b"0000000009", b"0000000099 000000009999 0123456789abcdef 0123456789abcdef\n"])
def test_a_tally_that_is_damaged_tells_nothing(tmp_path: Path, tally: bytes) -> None:
    path = tmp_path / "journal"
    with EventLog.begin(path, RECORDS[0]) as book:
        book.append(RECORDS[1])
    (tmp_path / ".journal-tally").write_bytes(tally)
    assert missing(path, "a journal") == 0
    (tmp_path / ".journal-tally").unlink()
    os.mkfifo(tmp_path / ".journal-tally")
    assert missing(path, "a journal") == 0


def test_the_reserve_is_required_before_more_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fault F5: what is on its way is taken down from the reserve, and nothing more is begun without one."""
    with EventLog.begin(tmp_path / "journal", RECORDS[0]) as book:
        book.require_reserve()
        (tmp_path / ".journal-reserve").unlink()

        def full(descriptor: int, place: int, size: int) -> None:
            raise OSError(errno.ENOSPC, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(os, "posix_fallocate", full)
            with pytest.raises(StorageError, match=r"No space left.*then resume"):
                book.require_reserve()
        book.require_reserve()
        assert (tmp_path / ".journal-reserve").stat().st_size == 2**20
        usage = namedtuple("usage", "total used free")
        monkeypatch.setattr(shutil, "disk_usage", lambda path: usage(2**40, 2**40 - 5000, 5000))
        with pytest.raises(StorageError, match="No space left"):
            book.require_reserve()
