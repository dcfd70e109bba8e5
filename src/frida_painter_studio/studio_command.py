"""Command that opens the studio: a web page on which a person and the robot paint together."""

import ipaddress
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from frida_painter import registry
from frida_painter.errors import ConfigError
from frida_painter.runs.options import MachineOptions, number_within, taking, whole_number_option, with_fields
from frida_painter.system import storage
from frida_painter.system.operating_system import IS_WINDOWS, user

if TYPE_CHECKING:
    from frida_painter_studio.server import Links
    from frida_painter_together.commands import Role


_LOCAL = "127.0.0.1"
MAX_MINUTES, USUAL_MINUTES = 1440, 30.0
"""Limits of a making, as in frida_painter_words/picture_makers/making.py, which loads tensors."""
_OPENING = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>Open the studio</title>
<meta http-equiv="refresh" content="0;url={link}"><p><a href="{link}">Open the studio</a></p></html>"""


def register(app: typer.Typer) -> None:
    """Adds the command."""
    app.command("studio")(with_fields(studio))


@dataclass(frozen=True)
class NetworkOptions:
    """Place of the studio in the network."""

    port: Annotated[int, whole_number_option(0, 65535, "The port. 0 takes a free port.")] = 8350
    address: Annotated[
        str,
        taking(
            "IP",
            "The IP address to listen on. Anybody who can reach it and has the link can move the robot. The link "
            "is not encrypted, so use it only in a network that you trust, or through a tunnel.",
        ),
    ] = _LOCAL
    name: Annotated[
        list[str] | None, taking("HOST", "A host name for that address in browsers, like easel.local. May be repeated.")
    ] = None
    stop_port: Annotated[
        int,
        whole_number_option(
            0, 65535, "The port on which nothing but stops is heard. A tunnel needs both ports. [dim]the next one[/]"
        ),
    ] = 0
    certificate: Annotated[Path | None, taking("FILE", "A certificate (PEM); the page is then served with https.")] = (
        None
    )
    key: Annotated[Path | None, taking("FILE", "The private key of the certificate (PEM).")] = None


def studio(
    *,
    folder: Annotated[Path, taking("FOLDER", "The folder of all paintings.")] = Path("paintings"),
    network: NetworkOptions,
    machine: MachineOptions,
    calibration: Annotated[
        Path | None,
        taking(
            "FILE",
            "The calibration record of the easel. Calibration on the page updates it. "
            "[dim]FOLDER/calibration/calibration.json[/]",
        ),
    ] = None,
    imagine: Annotated[
        list[str] | None,
        taking(
            "NAME:TEXT",
            "A picture maker that people at the page may choose, as in paint: they type words, look at its "
            "pictures and begin with one. May be repeated. No page can name another one. "
            "[dim]diffusers, if `models fetch imagine` got it[/]",
        ),
    ] = None,
    imagine_minutes: Annotated[
        float,
        taking(
            "X",
            "Minutes that a picture maker may take for the pictures of some words.",
            parser=number_within(0, MAX_MINUTES),
        ),
    ] = USUAL_MINUTES,
    link: Annotated[
        bool,
        typer.Option("--link", help="Print the links of the studio that is open in FOLDER, and open its page again."),
    ] = False,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")] = True,
) -> None:
    """Open the studio, a web page on which you set the goal, see the plan and paint together with the robot.

    Only this machine can open it, with the address that is printed. A real robot moves only after
    somebody beside it has pressed Enter in this terminal.
    """
    address = network.address
    _require_address(address)
    registry.require("web", "fastapi", "The studio")
    registry.require("web", "uvicorn", "The studio")
    from frida_painter_studio.network import Certificate
    from frida_painter_studio.picture_choosing import AllowedMakers
    from frida_painter_studio.server import OPENING_PAGE, listen, read_links, serve
    from frida_painter_studio.store import PaintingStore
    from frida_painter_studio.web_app_easel import WebAppEasel
    from frida_painter_together.commands import Role

    if link:
        links = read_links(folder.absolute())
        _print_links(links)
        if browser:
            page = folder.absolute() / OPENING_PAGE  # others can read a browser's command line, but not this file
            with storage.replacing(page, mode=0o600) as temporary:
                temporary.write_text(_OPENING.format(link=links[Role.operate]), encoding="utf-8")
            webbrowser.open(page.as_uri())
        return
    store = PaintingStore(folder.absolute())
    record = calibration or store.job("calibration").path / "calibration.json"
    place = machine.workspace and machine.workspace.absolute()
    easel = WebAppEasel(record.absolute(), machine.robot, machine.camera, place, machine.pace).validate()

    try:
        fetched = ("diffusers",) if registry.are_here(registry.IMAGINE) else ()
        makers = AllowedMakers.check(imagine or fetched, imagine_minutes)
    except ConfigError as fault:
        if imagine:
            raise
        print(f"The page makes no pictures from words: {fault}")
        makers = AllowedMakers()
    certified = Certificate.from_files(network.certificate, network.key)

    def tell(links: "Links") -> None:
        _print_links(links.roles)
        print(
            f"Paintings are kept in {store.root}. Ctrl-C closes the studio; a painting that is being painted goes on."
        )
        if easel.drives_machine:
            print(f"{easel.robot} moves only when somebody beside it has pressed Enter here within the last minute.")
        for label in makers.by_label:
            print(f"Whoever has a link to paint or to plan may have pictures made by {label}.")
        if not IS_WINDOWS and user() == 0:
            print("It runs as root: a fault in it would have the whole machine. Start it as an ordinary user.")
        if address != _LOCAL:
            read = "" if certified else ", and on the way they can be read (there is no encryption)"
            better = "" if certified else " Better: --certificate and --key, or an SSH tunnel to this machine."
            print(f"It listens on {address}: whoever has one of these links can use it{read}.{better}", flush=True)
        if browser:
            webbrowser.open(links.once)  # valid once: others can read a browser's command line

    names, door = tuple(network.name or ()), listen(address, network.port)
    serve(store, easel, door, names, tell, network.stop_port, certified, makers)


def _print_links(links: "dict[Role, str]") -> None:
    operate, plan, watch = (links[role] for role in sorted(links, reverse=True))
    print(f"The studio is open: {operate}", flush=True)
    print(f"  to plan, without starting the robot:  {plan}")
    print(f"  only to watch:                        {watch}")


def _require_address(address: str) -> None:
    try:
        known = ipaddress.ip_address(address)
    except ValueError as error:
        raise ConfigError(f"--address was given {address[:60]!r}; it is an IP address of this machine.") from error
    mapped = getattr(known, "ipv4_mapped", None)
    if known.is_unspecified or (mapped is not None and mapped.is_unspecified):
        raise ConfigError(
            f"--address {address} would listen on all networks that this machine is in; give the one address that "
            "is meant."
        )
