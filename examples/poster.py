"""A plan as a picture for a wall: python examples/poster.py PLAN.json POSTER.jpg [HEIGHT in pixels]."""

import sys

import frida_painter as fp


def main(plan: str, poster: str, height: str = "4320") -> None:
    fp.save_picture(fp.render_plan(fp.Plan.load(plan), int(height)), poster)


if __name__ == "__main__":
    main(*sys.argv[1:4])
