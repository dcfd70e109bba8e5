"""Parts of other packages: found by name, told of without being imported, and never in the way of the others."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from frida_painter import registry
from frida_painter.errors import PluginError
from frida_painter.hardware.kinds import CameraKind, RobotKind
from frida_painter.runs.options import camera_name
from plugins import install

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"
FINE = """
from frida_painter.hardware.kinds import CameraKind
KIND = CameraKind("peep", "peep:HOLE", "a hole in the wall", open=lambda where: None)
"""


def test_what_ships_is_registered_as_that_of_others_is_and_all_of_it_can_be_loaded() -> None:
    declared = tomllib.loads(PYPROJECT.read_text())["tool"]["setuptools"]["dynamic"]["entry-points"]["file"]
    assert (PYPROJECT.parent / declared).samefile(Path(registry.__file__).with_name("entry_points.txt"))
    for group in registry.OUR_PARTS:
        for part in registry.parts(group).values():
            assert part.load(object) is not None


def test_a_part_of_another_package_is_found_and_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    install(tmp_path, monkeypatch, "peep-hole", {registry.CAMERAS: {"peep": "peep_hole:KIND"}}, {"peep_hole": FINE})
    known = registry.parts(registry.CAMERAS)
    assert list(known) == ["opencv", "gphoto", "folder", "none", "peep"]
    assert known["peep"].packages == ("peep-hole",) and known["folder"].is_ours and not known["peep"].is_ours
    assert "peep_hole" not in sys.modules
    assert known["peep"].load(CameraKind).form == "peep:HOLE"


@pytest.mark.parametrize(
    ("module", "says"),
    [
        ("import no_such_driver", r"cannot be loaded \(ModuleNotFoundError: No module named 'no_such_driver'\)"),
        ("raise SystemExit(3)", "cannot be loaded"),
        ("OTHER = 1", "cannot be loaded .*KIND"),
        ("KIND = 'peep'", "is a str and should be a CameraKind"),
        (FINE.replace('"peep"', '"other"'), "calls itself 'other'; give it one name"),
    ],
)
def test_a_broken_one_is_named_with_its_package_and_leaves_the_others_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, says: str
) -> None:
    monkeypatch.delitem(sys.modules, "broken_hole", raising=False)
    install(
        tmp_path, monkeypatch, "broken-hole", {registry.CAMERAS: {"peep": "broken_hole:KIND"}}, {"broken_hole": module}
    )
    known = registry.parts(registry.CAMERAS)
    with pytest.raises(PluginError, match=f"'peep' of frida_painter.cameras, which the package broken-hole.*{says}"):
        known["peep"].load(CameraKind)
    assert known["folder"].load(CameraKind).name == "folder"
    monkeypatch.delitem(sys.modules, "broken_hole", raising=False)


@pytest.mark.parametrize("metadata", [b"[frida_painter.cameras]\nno equals sign", b"\xff\xfe[a"])
def test_a_package_with_damaged_metadata_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, metadata: bytes
) -> None:
    install(tmp_path / "damaged", monkeypatch, "damaged", {})
    install(tmp_path / "whole", monkeypatch, "whole", {registry.CAMERAS: {"peep": "peep_hole:KIND"}})
    (tmp_path / "damaged" / "damaged-1.0.dist-info" / "entry_points.txt").write_bytes(metadata)
    assert list(registry.parts(registry.CAMERAS)) == ["opencv", "gphoto", "folder", "none", "peep"]


def test_a_name_of_ours_stays_ours_and_two_others_that_share_one_are_both_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    theirs = {registry.ROBOTS: {"xarm": "evil:KIND", "golem": "evil:KIND"}}
    install(tmp_path / "one", monkeypatch, "first-golem", theirs)
    install(tmp_path / "two", monkeypatch, "second-golem", theirs)
    known = registry.parts(registry.ROBOTS)
    assert known["xarm"].load(RobotKind).title.startswith("UFACTORY")
    with pytest.raises(PluginError, match=r"registered by (first|second)-golem and by (first|second)-golem; uninstall"):
        known["golem"].load(RobotKind)


def test_names_are_listed_without_anything_that_computes_or_drives() -> None:
    """In a process of its own: what was loaded before by other tests does not count."""
    program = (
        "import sys; from frida_painter.easel import kinds as names\n"
        "assert names.is_machine('xarm:1') and names.is_simulated('virtual') and not names.is_simulated('human')\n"
        "print(*sys.modules)"
    )
    said = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not set(said.stdout.split()) & {"torch", "cv2", "numpy", "pydantic", "frida_painter_drivers.xarm"}


def test_a_camera_in_a_folder_is_named_by_its_whole_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert camera_name("folder:shots") == f"folder:{tmp_path / 'shots'}" and camera_name("opencv:0") == "opencv:0"
