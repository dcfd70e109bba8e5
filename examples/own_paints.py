"""Plans with paints that stand on the table already: python examples/own_paints.py PHOTO PAINTS.json PLAN.json.

PAINTS.json: {"paints": ["#f2e9dc", "#b97f2c", "#3b2f2a"]}.
"""

import sys

import frida_painter as fp


def main(photo: str, paints: str, plan: str, **settings: float) -> None:
    planner, palette = fp.make_planner(photo, palette=paints, **settings), fp.Palette.load(paints)
    wished = planner.plan()
    planner.bind_to_palette(wished, planner.bare, palette).save(plan)


if __name__ == "__main__":
    main(*sys.argv[1:4])
