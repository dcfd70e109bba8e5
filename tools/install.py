"""Installs the project into the Python that runs this: with uv where that sees the same packages as pip, else with pip.

`make` calls it with the environment's own Python. pip's settings (pip.conf, PIP_INDEX_URL and the
like) say where packages come from. uv does not read them, so they are handed to it; where one of
them has no counterpart, or uv fails, pip installs.
"""

import argparse
import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from time import monotonic

# Settings of pip that say nothing about which packages are installed, or from where.
HARMLESS = {
    "cache-dir",
    "disable-pip-version-check",
    "no-cache-dir",
    "no-color",
    "no-input",
    "no-python-version-warning",
    "progress-bar",
    "quiet",
    "require-virtualenv",
    "retries",
    "root-user-action",
    "verbose",
}
# Which options of uv mean the same; one for each word of the value.
OPTIONS = {
    "index-url": "--default-index",
    "extra-index-url": "--index",
    "find-links": "--find-links",
    "trusted-host": "--allow-insecure-host",
}
VARIABLES = {"cert": "SSL_CERT_FILE", "timeout": "UV_HTTP_TIMEOUT", "default-timeout": "UV_HTTP_TIMEOUT"}
SECTIONS = ("global", "install", ":env:")  # what `pip install` obeys; the later one wins


def pip_settings(listed: str) -> dict[str, str]:
    """What `pip config list` printed, as far as `pip install` obeys it: names without their section."""
    found: dict[str, dict[str, str]] = {section: {} for section in SECTIONS}
    for line in listed.splitlines():
        key, _, value = line.partition("=")
        section, _, name = key.rpartition(".")
        if section in found:
            found[section][name] = str(ast.literal_eval(value))
    return {name: value for section in SECTIONS for name, value in found[section].items()}


def for_uv(settings: dict[str, str]) -> tuple[list[str], dict[str, str]] | None:
    """The options and environment variables by which uv finds what pip would find; None where there are none."""
    # Like pip, uv is to compare the versions of all indexes. Left alone, it stops at the first that knows the name.
    options, variables = ["--index-strategy", "unsafe-best-match"], {}
    for name, value in settings.items():
        if name in OPTIONS:
            options += [part for word in value.split() for part in (OPTIONS[name], word)]
        elif name in VARIABLES:
            variables[VARIABLES[name]] = value if name == "cert" else str(round(float(value)))
        elif name == "no-index" and value.lower() in ("1", "true", "yes", "on"):
            options.append("--no-index")
        elif name not in HARMLESS:
            return None
    return options, variables


def install(requirement: str, constraints: Path) -> str:
    """Installs and returns what did it. Raises CalledProcessError where pip fails, which has said why."""
    wanted = ["--constraint", str(constraints), "--editable", requirement]
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    uv = shutil.which("uv")
    if uv is not None:
        listed = subprocess.run([*pip, "config", "list"], capture_output=True, text=True, check=True).stdout
        same = for_uv(pip_settings(listed))
        if same is None:
            print("  uv is here, but pip's configuration has settings that uv does not know: pip installs.", flush=True)
        else:
            command = [uv, "pip", "install", "--quiet", "--python", sys.executable, *same[0], *wanted]
            if subprocess.run(command, env={**os.environ, **same[1]}, check=False).returncode == 0:
                return "uv"
            print("  uv could not install it: pip tries.", flush=True)
    subprocess.run([*pip, "install", "--quiet", *wanted], check=True)
    return "pip"


def main() -> int:
    """Exit status 0 when it is installed, else pip's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("requirement", help="the project's folder, with extras: .[dev]")
    parser.add_argument("--constraints", type=Path, default=Path("constraints.txt"))
    given = parser.parse_args()
    began = monotonic()
    try:
        by = install(given.requirement, given.constraints)
    except subprocess.CalledProcessError as error:
        print("  It could not be installed; what pip says above names the reason.", file=sys.stderr)
        return int(error.returncode) or 1
    print(f"  Installed by {by} in {monotonic() - began:.0f} s.", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
