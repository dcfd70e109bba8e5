"""Files that tell which paints were really mixed: colours as JSON, or a photograph of swatches."""

from pathlib import Path

from frida_painter import images
from frida_painter.errors import ConfigError
from frida_painter.palette import Palette
from frida_painter.perception.swatches import read_swatches


def read_palette(path: Path, count: int | None) -> Palette:
    """The palette of a JSON file, or of a photograph of `count` swatches.

    Raises ConfigError, ImageError and FrameRejected; ConfigError also where it has not `count` paints.
    """
    if path.suffix.lower() == ".json":
        palette = Palette.load(path)
        if count is not None and len(palette) != count:
            raise ConfigError(f"{path} has {len(palette)} paints, and {count} are wanted; give one colour for each.")
        return palette
    if count is None:
        raise ConfigError(f"How many swatches {path} shows is not known; say it with --colors.")
    return read_swatches(images.load(path), count)
