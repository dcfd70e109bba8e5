"""A piece of work that a worker does for the page: for which painting, where, and who hears of it."""

from dataclasses import dataclass

from frida_painter.cli.real import Site
from frida_painter.config import PaintingSettings
from frida_painter.session.easel_order import EaselOrder
from frida_painter.session.easel_process import state_folder
from frida_painter.session.names import SAWYER_SIM
from frida_painter.web.asking import Asker
from frida_painter.web.feed import Feed
from frida_painter.web.folder import PaintingFolder
from frida_painter.web.station import Station
from frida_painter.web.stop_file import Stop


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

    def order(self, settings: PaintingSettings, brush: str) -> EaselOrder:
        """The easel for it.

        A stop latches the robot until somebody has looked; a simulated one lives in the world of its painting alone.
        """
        station = self.station
        return EaselOrder(
            robot=station.robot,
            canvas=settings.canvas,
            brush=brush,
            seed=settings.seed,
            state=self.folder.easel if station.simulated else state_folder(),
            folder=self.folder.painting.absolute(),
            workspace=None if station.workspace is None else station.workspace.absolute(),
            camera=station.camera,
            pace=station.pace if station.simulated else 0.0,
            film=station.robot == SAWYER_SIM,
        )
