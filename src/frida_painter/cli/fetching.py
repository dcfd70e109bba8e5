"""What is shown on the terminal while networks are fetched."""

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, DownloadColumn, Progress, TextColumn, TimeRemainingColumn, TransferSpeedColumn

from frida_painter import weights
from frida_painter.cli.progress import Line
from frida_painter.quantities import megabytes


class FetchProgress(Line):
    """On the terminal: from where and how much, how far it is, and why a source did not give it."""

    def __init__(self, console: Console) -> None:
        self._console = console
        super().__init__(
            Progress(
                TextColumn("{task.description}"),
                BarColumn(bar_width=36),
                DownloadColumn(),
                TransferSpeedColumn(),
                TimeRemainingColumn(),
                console=console,
                transient=True,
                disable=not console.is_terminal,
            )
        )

    def hear(self, notice: weights.Notice) -> None:
        """Shows what is told."""
        match notice:
            case weights.Announced(name, source, size, remote):
                how = "downloading" if remote else "copying"
                self._say(f"{name}: {how} {megabytes(size)} from {source}")
                self._bar.add_task(name, total=size)
            case weights.Received(_, done, of):
                words = "checking and converting" if done == of else notice.name
                self._bar.update(self._bar.task_ids[-1], completed=done, description=words)
            case weights.Refused(name, source, reason):
                self._bar.remove_task(self._bar.task_ids[-1])
                self._say(f"{name}: not from {source}: {reason}")

    def _say(self, words: str) -> None:
        self._console.print(escape(words), soft_wrap=True)
