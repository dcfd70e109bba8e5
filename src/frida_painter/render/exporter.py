"""Export of a plan to a file for other programs, by exporters of this and other packages."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from frida_painter import registry
from frida_painter.errors import ConfigError, PluginError
from frida_painter.strokes.plan import Plan
from frida_painter.system import storage


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export, named as those of `frida-painter export`. An exporter takes those that its kind names.

    source: file of the plan, or folder of the painting; None if the plan comes from no file
    """

    regroup: bool = False
    dips: bool = False
    flavour: str | None = None
    press: float | None = None
    lift: float | None = None
    workspace: Path | None = None
    calibration: Path | None = None
    drying: float | None = None
    own: Path | None = None
    refill: float | None = None
    title: str = ""
    signature: str = ""
    source: Path | None = None

    @property
    def given(self) -> list[str]:
        """Names of the options that are given."""
        return [name for name, value in vars(self).items() if name != "source" and value not in (None, False, "")]


@dataclass(frozen=True)
class ExporterKind:
    """Description of a file format for plans.

    name: as in `export --to NAME`, and the ending of its files
    help: one sentence
    make: returns the content of the file; raises ConfigError
    options: options that it takes, as in `ExportOptions`
    """

    name: str
    help: str
    make: Callable[[Plan, ExportOptions], str | bytes]
    options: tuple[str, ...] = ()

    def export(self, plan: Plan, options: ExportOptions | None = None) -> str | bytes:
        """Returns the content of the file. Raises ConfigError for options of another format, PluginError."""
        options = options or ExportOptions()
        for name in options.given:
            if name not in self.options:
                others = [kind.name for kind in exporters().values() if name in kind.options]
                raise ConfigError(
                    f"--{name} was given with --to {self.name}; it is for --to {', '.join(others)}; leave it out."
                )
        content = self.make(plan, options)
        if not isinstance(content, str | bytes):
            raise PluginError(
                f"The exporter {self.name!r} returned a {type(content).__name__}; it returns text or bytes; mend it."
            )
        return content


def exporters() -> dict[str, ExporterKind]:
    """Returns all exporters by name. Raises PluginError if one cannot be loaded."""
    return {name: part.load(ExporterKind) for name, part in registry.parts(registry.EXPORTERS).items()}


def find_exporter(name: str) -> ExporterKind:
    """Returns the exporter of that name. Raises ConfigError if there is none, PluginError if it is broken."""
    return registry.load_part(registry.EXPORTERS, name, ExporterKind, "exporter")


def export_plan(
    plan: Plan | str | Path, path: str | Path, to: str | None = None, options: ExportOptions | None = None
) -> Path:
    """Writes a plan to a file for other programs: SVG, G-code, CSV, PNG, or a format of another package.

    plan: a plan, its file, or the folder of a painting
    to: name of the format. None: the ending of the file
    Returns the path of the file. Raises ConfigError for an unknown format, PlanError and StorageError.

        >>> import frida_painter as fp
        >>> plan = fp.make_planner("photo.jpg", strokes=5, colors=3, render_height=64).plan()
        >>> fp.export_plan(plan, "strokes.svg").name
        'strokes.svg'
    """
    path = Path(path)
    kind = find_exporter(to or path.suffix.removeprefix(".").lower())
    source = None if isinstance(plan, Plan) else Path(plan)
    loaded = plan if isinstance(plan, Plan) else Plan.load(plan)
    content = kind.export(loaded, options or ExportOptions(source=source))
    storage.write_bytes(path, content.encode() if isinstance(content, str) else content)
    return path
