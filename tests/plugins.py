"""Packages of other people, installed for one test: real entry points, in this process and in those that it starts."""

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path

import pytest

OWN_PARTS = Path(__file__).parents[1] / "examples" / "own_parts"


def install(
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    package: str,
    points: Mapping[str, Mapping[str, str]],
    modules: Mapping[str, str] | None = None,
) -> None:
    """Puts modules and the metadata of a distribution that registers `points` (by group and name) into `folder`."""
    about = folder / f"{package.replace('-', '_')}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    groups = (
        "\n".join((f"[{group}]", *(f"{name} = {at}" for name, at in names.items()))) for group, names in points.items()
    )
    (about / "entry_points.txt").write_text("\n".join(groups) + "\n")
    for name, text in (modules or {}).items():
        (folder / f"{name}.py").write_text(text)
    _on_path(monkeypatch, folder)


def install_own_parts(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The example of a package with parts of one's own, as pip would install it in editable form."""
    project = tomllib.loads((OWN_PARTS / "pyproject.toml").read_text())["project"]
    install(folder, monkeypatch, project["name"], project["entry-points"])
    _on_path(monkeypatch, OWN_PARTS)


def _on_path(monkeypatch: pytest.MonkeyPatch, folder: Path) -> None:
    monkeypatch.syspath_prepend(str(folder))
    inherited = os.environ.get("PYTHONPATH")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, (str(folder), inherited))))
