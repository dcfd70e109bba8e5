"""Work of `plan`: plans a painting into a folder, once or as several variants side by side to choose from."""

import json
import os
import shlex
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console

from frida_painter.errors import Interrupted
from frida_painter.mixing.shopping import supplies
from frida_painter.planning.mixable import mixing_changes
from frida_painter.planning.optimize import Step
from frida_painter.report.sheets import Cell, FigureRow, RecipeSheets, page
from frida_painter.runs.painting_folder import new_folder
from frida_painter.runs.run import PaintingRun
from frida_painter.runs.settle import paints_for_recipes
from frida_painter.runs.spec import RunSpec
from frida_painter.runs.variant_settings import VARIANT, VARIANTS, variant_of
from frida_painter.session.choreography import BrushLoad, Choreography, reckon
from frida_painter.session.rehearsal import FlatbedWorkspace
from frida_painter.session.time_left import share_of_plan
from frida_painter.strokes.plan import Plan
from frida_painter.system import images
from frida_painter.system.devices import prepare_process
from frida_painter.system.python_process import in_own_process
from frida_painter.system.storage import count_of
from frida_painter_cli.leading import PLAN_ROOM, ready_planner, say
from frida_painter_cli.stop_signal import StopSignal, stop_on_signals
from frida_painter_cli.terminal import PlanningLine

_STOPPED = "You stopped the planning, and nothing more was saved. Run the command again to plan from the start."
_WIDTH = 520  # pixels of a variant on the sheet


def write_plan(run: PaintingRun, made: Plan, folder: Path) -> tuple[str, ...]:
    """Writes a plan with its picture, palette, recipes and shopping list; returns lines for people."""
    picture, forecast = run.planner.expected(made), run.forecast(made)
    images.save(picture, folder / "plan.png")
    bought = supplies(RecipeSheets(folder, paints_for_recipes(run.spec)).write(made))
    run.plan_into(folder, made)  # the last, because its record holds the hashes of all files
    return (
        f"The plan:    {folder / 'plan.json'}",
        f"As picture:  {folder / 'plan.png'}",
        f"Palette:     {folder / 'palette.png'}; how to mix it: {folder / 'mixing.png'}",
        f"Paints:      {count_of(sum(len(one.tubes) for one in bought), 'tube')} to buy: {folder / 'shopping.txt'}",
        *([f"Similarity:  {forecast} (PSNR at {picture.shape[2]} x {picture.shape[1]} pixels)"] if forecast else []),
        *(f"{what}: {words}" for what, words in mixing_changes(made).items()),
    )


def plan_once(spec: RunSpec, out: Path | None) -> None:
    """Plans and prints what there is."""
    prepare_process()
    with stop_on_signals() as stop, PaintingRun(spec) as run:
        expected = ready_planner(run, stop, out)
        folder = new_folder(out, run.spec.name, PLAN_ROOM)
        with PlanningLine(Console(stderr=True, highlight=False), expected) as bar:

            def hear(step: Step) -> None:
                bar.hear(step)
                _heed(stop)

            made = run.plan(hear)
        say(*write_plan(run, made, folder))


def _heed(stop: StopSignal) -> None:
    if stop.asked:
        raise Interrupted(_STOPPED)


@in_own_process()
def make_variant(name: str, settings: str, folder: Path, tell: Callable[[float], None]) -> str:
    """Plans one variant into a folder; returns its figures in words, with about the minutes of a robot.

    settings: those of the person, as JSON
    tell: receives the share that is done
    """
    prepare_process()
    with PaintingRun(variant_of(RunSpec.of(**json.loads(settings)), name)) as run:
        made = run.plan(lambda step: tell(share_of_plan(step.iteration, step.of)))
        made = replace(made, about=(*made.about, (VARIANT, name)))
        write_plan(run, made, folder)
        usual = Choreography.of(FlatbedWorkspace().motion(made.canvas), made.brushes)
        minutes = reckon(made, usual, BrushLoad(), drying=60 * run.spec.drying).total / 60
        forecast = run.forecast(made)
        near = "" if forecast is None else f", {forecast.expected:.1f} dB"
        return f"{count_of(len(made), 'stroke')}, {len(made.palette)} paints, about {minutes:.0f} minutes{near}"


def plan_variants(spec: RunSpec, out: Path | None, count: int) -> None:
    """Plans the first variants of the table, as many at a time as there are cores, and prints how to paint each."""
    prepare_process()
    for name in [*VARIANTS][:count]:
        PaintingRun(variant_of(spec, name))  # raises what is wrong, before there is a folder
    folder = new_folder(out, spec.name, count * PLAN_ROOM)
    folders = {name: folder / f"{number}-{name}" for number, name in enumerate([*VARIANTS][:count], 1)}
    settings, shares = spec.model_dump_json(include=spec.model_fields_set), dict.fromkeys(folders, 0.0)
    workers = ThreadPoolExecutor(min(count, os.cpu_count() or 1))
    with stop_on_signals() as stop, PlanningLine(Console(stderr=True, highlight=False)) as bar, workers:

        def hear(name: str, share: float) -> None:
            shares[name] = share
            bar.show(sum(shares.values()) / count)

        make = replace(make_variant, heed=partial(_heed, stop))
        begun = {}
        for name, place in folders.items():
            place.mkdir()
            begun[name] = workers.submit(make, name, settings, place, partial(hear, name))
        found = {name: future.result() for name, future in begun.items()}
    cells = [Cell(images.load(place / "plan.png"), found[name]) for name, place in folders.items()]
    headings = [place.name for place in folders.values()]
    images.save(page(spec.name, headings, [FigureRow("", cells)], width=_WIDTH), folder / "variants.png")
    say(*(f"{place.name:<12} {found[name]}: {place / 'plan.json'}" for name, place in folders.items()))
    say(f"Side by side: {folder / 'variants.png'}", f"To paint one: {_command(next(iter(folders.values())))}")


def _command(folder: Path) -> str:
    """Returns the command that paints a variant: the typed one, with the plan in place of the variants."""
    words, kept = iter(sys.argv[2:]), []
    for word in words:
        option, equals, _ = word.partition("=")
        if option not in ("--variants", "--out"):
            kept.append(word)
        elif not equals:
            next(words, None)
    return f"frida-painter paint {shlex.join([*kept, '--plan', str(folder)])}"
