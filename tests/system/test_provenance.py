"""What makes a result: a change of code, of a plug-in or of a library is seen, and nothing else is."""

import shutil
from pathlib import Path

import pytest

from frida_painter.registry import OBJECTIVES
from frida_painter.system import provenance
from plugins import install


def test_the_facts_name_program_libraries_and_code() -> None:
    facts = provenance.describe_here()
    assert {"frida-painter", "code", "python", "torch", "numpy", "device", "machine"} <= set(facts)
    assert all(isinstance(value, str) and value for value in facts.values())
    assert facts == provenance.describe_here()
    line = provenance.identify(facts)
    assert f"torch {facts['torch']}" in line and facts["code"] in line and "machine" not in line


def test_a_plug_in_has_version_and_hash_of_its_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = provenance.identify(provenance.describe_here())
    install(tmp_path, monkeypatch, "calm", {OBJECTIVES: {"calm": "calm_parts:KIND"}}, {"calm_parts": "a = 1\n"})
    facts = provenance.describe_here()
    assert facts["plug-in calm"].startswith("1.0 code ")
    (tmp_path / "calm_parts.py").write_text("a = 22\n")
    changed = provenance.describe_here()
    assert provenance.compare_facts(facts, changed) == [
        f"plug-in calm was {facts['plug-in calm']} and is {changed['plug-in calm']} here"
    ]
    assert len({before, provenance.identify(facts), provenance.identify(changed)}) == 3


def test_the_hash_is_of_names_and_contents(tmp_path: Path) -> None:
    one = tmp_path / "one"
    (one / "inner").mkdir(parents=True)
    (one / "a.py").write_text("1")
    (one / "inner" / "b.py").write_text("2")
    first = provenance.hash_code(one)
    shutil.copytree(one, tmp_path / "other")
    assert provenance.hash_code(tmp_path / "other") == first
    (one / "__pycache__").mkdir()
    (one / "__pycache__" / "a.py").write_text("3")
    (one / "notes.md").write_text("3")
    assert provenance.hash_code(one) == first
    (one / "inner" / "b.py").rename(one / "inner" / "c.py")
    assert provenance.hash_code(one) != first
    assert provenance.hash_code(tmp_path / "gone") == provenance.hash_code(tmp_path / "nothing")


def test_what_does_not_decide_is_no_difference() -> None:
    facts = provenance.describe_here()
    assert provenance.compare_facts(facts, {**facts, "commit": "x", "processor": "y"}) == []
    assert provenance.compare_facts(facts, {**facts, "device": "cuda"}) == ["device was cpu and is cuda here"]
