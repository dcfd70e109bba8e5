"""Two plans that differ in nothing but chance, side by side: python examples/compare_seeds.py PHOTO PICTURE.png."""

import sys

import torch

import frida_painter as fp


def main(photo: str, picture: str, **settings: float) -> None:
    planners = [fp.make_planner(photo, seed=seed, **settings) for seed in (0, 1)]
    pictures = [planner.expected(planner.plan()) for planner in planners]
    fp.save_picture(torch.cat(pictures, dim=2), picture)
    first, second = (planner.validation_loss(each) for planner, each in zip(planners, pictures, strict=True))
    print(f"The first is {first:.4f} off, the second {second:.4f}.")


if __name__ == "__main__":
    main(*sys.argv[1:3])
