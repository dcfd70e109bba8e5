"""A stroke model of your own, a felt pen: python examples/own_stroke_model.py PHOTO PICTURE.png."""

import sys

import torch

import frida_painter as fp


class FeltPen:
    def __init__(self, like: fp.StrokeModel) -> None:  # what it can do, and where its marks lie, stay the same
        self.brush, self.frame, self.limits = like.brush, like.frame, like.limits

    def __call__(self, thickness: torch.Tensor, length: torch.Tensor, bend: torch.Tensor) -> torch.Tensor:
        x, y = self.frame.cell_centers().unbind(-1)
        half, end, bow = (part[:, None, None] for part in (0.003 + 0.005 * thickness, length, bend))
        at = (x / end).clamp(0, 1)  # how far along the stroke its path is nearest
        away = ((x - at * end).square() + (y - 3 * at * (1 - at) * bow).square() + 1e-9).sqrt()
        return torch.sigmoid((half - away) / 0.0005)


def main(photo: str, picture: str, **settings: float) -> None:
    planner = fp.make_planner(photo, model=FeltPen(fp.load_stroke_model("broad")), **settings)
    fp.save_picture(planner.expected(planner.plan()), picture)


if __name__ == "__main__":
    main(*sys.argv[1:3])
