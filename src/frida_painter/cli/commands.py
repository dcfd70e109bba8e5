"""All commands of the command line, put together."""

import typer

from frida_painter.cli.arm import register as register_arm
from frida_painter.cli.calibration import register as register_calibration
from frida_painter.cli.check import register as register_check
from frida_painter.cli.experiments import build as experiments
from frida_painter.cli.export import export
from frida_painter.cli.mix import register as register_mix
from frida_painter.cli.models import build as models
from frida_painter.cli.painting import register as register_painting
from frida_painter.cli.resume import register as register_resume
from frida_painter.cli.strokes import build as strokes
from frida_painter.cli.studio import register as register_studio


def register(app: typer.Typer) -> None:
    """Adds all commands."""
    register_painting(app)
    register_resume(app)
    app.command("export")(export)
    register_calibration(app)
    register_arm(app)
    register_check(app)
    register_mix(app)
    register_studio(app)
    app.add_typer(strokes(), name="strokes")
    app.add_typer(models(), name="models")
    app.add_typer(experiments(), name="experiments")
