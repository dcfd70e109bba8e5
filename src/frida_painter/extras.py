"""Command that installs an extra of this project, such as "web", into the installation that runs."""

import shlex
import shutil
import sys
import sysconfig
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from packaging.requirements import Requirement

PROJECT = "frida-painter"


def install_command(extra: str) -> str:
    """Returns the command that installs what an extra of this project lacks into this installation, for a shell.

    It names packages and versions from the metadata, because the project itself need not be on any index. Without
    metadata it names the folder of the project.
    """
    from packaging.requirements import Requirement

    try:
        declared = [Requirement(line) for line in requires(PROJECT) or ()]
    except PackageNotFoundError:
        declared = []
    wanted = [one for one in declared if _is_for(one, extra) and not _is_for(one, "")]
    lacking = [one for one in wanted if not _is_satisfied(one)] or wanted  # all, if one is here but broken
    packages = [str(one).partition(";")[0] for one in lacking] or [f"{Path(__file__).parents[2]}[{extra}]"]
    python = shlex.quote(sys.executable)
    command = f"{python} -m pip install"
    if find_spec("pip") is None:
        uses_uv = shutil.which("uv") is not None
        command = f"uv pip install --python {python}" if uses_uv else f"{python} -m ensurepip && {command}"
    if sys.prefix == sys.base_prefix and Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED").is_file():
        command += " --break-system-packages"  # this project was installed so
    return f"{command} {shlex.join(packages)}"


def _is_for(one: "Requirement", extra: str) -> bool:
    return one.marker is None or one.marker.evaluate({"extra": extra})


def _is_satisfied(one: "Requirement") -> bool:
    try:
        return one.specifier.contains(version(one.name), prereleases=True)
    except PackageNotFoundError:
        return False
