"""Plans a photograph: python examples/plan_photograph.py PHOTO FOLDER."""

import sys

import frida_painter as fp


def main(photo: str, folder: str, **settings: float) -> None:
    planner = fp.make_planner(photo, **settings)
    plan = planner.plan()
    plan.save(f"{folder}/plan.json")
    fp.save_picture(planner.expected(plan), f"{folder}/plan.png")


if __name__ == "__main__":
    main(*sys.argv[1:3])
