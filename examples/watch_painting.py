"""Paints a photograph and keeps what the camera sees: python examples/watch_painting.py PHOTO FOLDER PICTURES."""

import sys

import frida_painter as fp


def main(photo: str, folder: str, pictures: str, **settings: float) -> None:
    def tell(event: object) -> None:
        if type(event).__name__ == "Looked":
            fp.save_picture(event.photograph, f"{pictures}/after-{event.done}.png")
            print(f"{event.done} strokes are on the canvas.")

    spec = fp.RunSpec.of(goal=[{"image": photo}], **settings)
    with fp.PaintingRun(spec, folder, listeners=[tell]) as run:
        run.start()


if __name__ == "__main__":
    main(*sys.argv[1:4])
