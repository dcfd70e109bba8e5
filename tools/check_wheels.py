"""Tells if the package index has a built file of each locked package that painting and its page need, by machine.

It asks with pip, and installs nothing: some minutes. The exit status is 1 if something is missing.
"""

import re
import subprocess
import sys
import tempfile

from pip._vendor.packaging.utils import canonicalize_name

from install import PIP, ROOT, asked_by, needs_of, read_lock

# Kinds of machine by the tags that pip knows them by.
MACHINES = {
    "Windows": ("win_amd64",),
    "Mac with an Apple processor": tuple(f"macosx_{version}_0_arm64" for version in (11, 12, 13, 14)),
    "Raspberry Pi and others (ARM)": tuple(f"manylinux_2_{version}_aarch64" for version in (17, 24, 27, 28)),
    "Linux (Intel and AMD)": tuple(f"manylinux_2_{version}_x86_64" for version in (17, 24, 27, 28)),
}
PYTHONS = ("3.11", "3.12", "3.13")
BUILT_HERE = ("pyvips",)  # Python alone, built in a second


def locked() -> list[str]:
    """The packages as NAME==VERSION; those that are installed here tell which others they need."""
    lock, level = read_lock(ROOT / "constraints.txt"), asked_by(".[web,plotter]")
    known: dict[str, str] = {}
    while level:
        new = [each for each in level if (name := canonicalize_name(each.name)) not in known and name in lock]
        known |= {(name := canonicalize_name(each.name)): re.split(r"[\s;]", lock[name][0])[0] for each in new}
        level = [needed for each in new for extra in ("", *each.extras) for needed in needs_of(each.name, extra)]
    return sorted(package for name, package in known.items() if name not in BUILT_HERE)


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
    lacking = False
    for machine, tags in MACHINES.items():
        for python in PYTHONS:
            missing = find_missing(packages, tags, python)
            lacking = lacking or bool(missing)
            print(f"{machine}, Python {python}: {' '.join(missing) or 'all'}", flush=True)
    return int(lacking)


if __name__ == "__main__":
    sys.exit(main())
