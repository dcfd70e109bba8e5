"""Paints a photograph in the virtual studio: python examples/paint_photograph.py PHOTO FOLDER."""

import sys

import frida_painter as fp


def main(photo: str, folder: str, **settings: float) -> None:
    spec = fp.RunSpec.of(goal=[{"image": photo}], **settings)
    with fp.PaintingRun(spec, folder) as run:
        outcome = run.start()
    print(f"{outcome.painting.painted} strokes: {outcome.page}")


if __name__ == "__main__":
    main(*sys.argv[1:3])
