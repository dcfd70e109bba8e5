"""Tells if the package index has a built file of each locked package that painting, its page and devices need.

It asks with pip for each kind of machine, and installs nothing: some minutes. The exit status is 1 if something is
missing, or if pyproject.toml says by a marker that a package does not exist for a machine, and it does.
"""

import re
import subprocess
import sys
import tempfile

from pip._vendor.packaging.markers import Marker
from pip._vendor.packaging.utils import canonicalize_name

from frida_painter.registry import SYSTEMS
from install import PIP, ROOT, asked_by, needs_of, read_lock

# Kinds of machine by the tags that pip knows them by.
MACHINES = {
    "Windows": ("win_amd64",),
    "macOS": tuple(f"macosx_{version}_0_arm64" for version in (11, 12, 13, 14)),
    "Linux on ARM": tuple(f"manylinux_2_{version}_aarch64" for version in (17, 24, 27, 28)),
    "Linux on Intel and AMD": tuple(f"manylinux_2_{version}_x86_64" for version in (17, 24, 27, 28)),
}
PYTHONS = ("3.11", "3.12", "3.13")
NEEDED = ".[web,plotter,xarm,franka,so101,gphoto]"
BUILT_HERE = ("pyvips", "feetech-servo-sdk")  # Python alone, built in a second


def locked() -> dict[str, Marker | None]:
    """The packages as NAME==VERSION, each with the marker of pyproject.toml that says for which machines it exists.

    Those that are installed here tell which others they need.
    """
    lock, level = read_lock(ROOT / "constraints.txt"), asked_by(NEEDED)
    known: dict[str, tuple[str, Marker | None]] = {}
    while level:
        new = [each for each in level if (name := canonicalize_name(each.name)) not in known and name in lock]
        for each in new:
            name = canonicalize_name(each.name)
            known[name] = re.split(r"[\s;]", lock[name][0])[0], each.marker
        level = [needed for each in new for extra in ("", *each.extras) for needed in needs_of(each.name, extra)]
    return dict(sorted(each for name, each in known.items() if name not in BUILT_HERE))


def find_missing(packages: list[str], tags: tuple[str, ...], python: str) -> list[str]:
    """The packages of which pip finds no built file."""
    asks = [*PIP, "install", "--dry-run", "--quiet", "--no-deps", "--ignore-installed", "--only-binary", ":all:"]
    asks += ["--python-version", python, *(word for tag in tags for word in ("--platform", tag))]
    missing: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        while left := [package for package in packages if package not in missing]:
            done = subprocess.run([*asks, "--target", folder, *left], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                break
            found = re.search(r"No matching distribution found for (\S+)", done.stderr)
            if found is None:
                sys.exit(done.stderr)
            missing.append(found[1])
    return missing


def main() -> int:
    """Exit status 0 if nothing is missing."""
    packages = locked()
    print(f"{len(packages)} packages: {' '.join(packages)}")
    wrong = False
    for machine, tags in MACHINES.items():
        absent = [name for name, marker in packages.items() if marker and not marker.evaluate(SYSTEMS[machine])]
        for python in PYTHONS:
            missing = find_missing([name for name in packages if name not in absent], tags, python)
            there = [name for name in absent if not find_missing([name], tags, python)]
            wrong = wrong or bool(missing or there)
            print(f"{machine}, Python {python}: {' '.join(missing) or 'all'}", flush=True)
            print(f"  not for it: {' '.join(absent) or 'none'}; there all the same: {' '.join(there) or 'none'}")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
