"""A piece of work that a worker does for the page: for which painting, where, and who hears of it."""

from dataclasses import dataclass

from frida_painter.cli.real import Site
from frida_painter.web.asking import Asker
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.station import Station
from frida_painter.web.stop import Stop


@dataclass(frozen=True)
class Job:
    """What every piece of work has."""

    folder: PaintingFolder
    station: Station
    feed: Feed
    stop: Stop
    asker: Asker

    @property
    def site(self) -> Site:
        """Where it is painted, in the terms of the command line."""
        return Site(self.station.robot, self.station.camera, self.station.workspace)
