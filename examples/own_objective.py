"""An objective of your own, a calm picture: python examples/own_objective.py PHOTO PICTURE.png."""

import sys

import torch

import frida_painter as fp


def unrest(picture: torch.Tensor) -> torch.Tensor:
    """How much neighbouring pixels of [3, H, W] differ; smaller is calmer."""
    return picture.diff(dim=1).abs().mean() + picture.diff(dim=2).abs().mean()


def main(photo: str, picture: str, weight: float = 0.5, **settings: float) -> None:
    goal = fp.make_goal(photo, objective=unrest, weights={"objective": weight})
    planner = fp.make_planner(goal, **settings)
    fp.save_picture(planner.expected(planner.plan()), picture)


if __name__ == "__main__":
    main(*sys.argv[1:3])
