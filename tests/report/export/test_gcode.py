import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from frida_painter.brush.kinds import MEDIUM
from frida_painter.errors import ConfigError
from frida_painter.hardware.gcode import Gcode, Servo
from frida_painter.hardware.motion import Motion
from frida_painter.hardware.robot import Waypoints
from frida_painter.report.gcode import gcode
from frida_painter.report.vector import control_points
from frida_painter.session.choreography import Action, BrushLoad, Choreography
from frida_painter.session.events import Dipped
from frida_painter.session.rehearsal import FlatbedWorkspace
from frida_painter.strokes.palette import to_hex
from frida_painter.strokes.plan import Plan
from support.easel import CALIBRATION, WORKSPACE
from support.plans import CANVAS, in_layers, made_up_plan

PLAN = made_up_plan(12, 3)
MORE = made_up_plan(4, 2, seed=1)


def actions(plan: Plan = PLAN, flatbed: FlatbedWorkspace | None = None) -> list[Action]:
    motion = (flatbed or FlatbedWorkspace()).motion(plan.canvas)
    return list(Choreography.of(motion, plan.brushes).actions(plan, BrushLoad(), 0, len(plan)))


def travelled(program: str) -> list[np.ndarray]:
    """Reads a program as a machine does: the places [k, 3] in mm of each part between two pauses."""
    place, parts = np.zeros(3), [[np.zeros(3)]]
    for line in program.splitlines():
        words = dict(re.findall(r"([XYZ])(-?[\d.]+)", line.partition(";")[0]))
        if line.startswith("G1"):
            place = np.array([float(words.get(axis, place[i])) for i, axis in enumerate("XYZ")])
            parts[-1].append(place)
        elif line.startswith("M0"):
            parts.append([place])
    return [np.array(part) for part in parts]


def test_a_machine_that_obeys_goes_along_every_stroke_from_the_canvas_corner() -> None:
    places = np.concatenate(travelled(gcode(PLAN, actions(), Gcode(), pauses=True))) / 1000
    for start, _, _, end in control_points(PLAN.strokes).tolist():
        for point in (start, end):
            assert np.linalg.norm(places[:, :2] - point, axis=1).min() < 1e-5
    assert places[:, 2].min() >= -0.002 - 1e-9 and places[:, 2].max() == pytest.approx(0.005)
    assert (places[:, :2] >= -1e-6).all() and (places[:, :2] <= (CANVAS.width, CANVAS.height)).all()


def test_it_crosses_the_canvas_only_lifted_and_is_lifted_at_every_pause() -> None:
    parts = travelled(gcode(PLAN, actions(), Gcode(), pauses=True))
    for part in parts[1:]:
        assert part[-1][2] == pytest.approx(5)
        step = np.linalg.norm(np.diff(part[:, :2], axis=0), axis=1)
        lifted = np.minimum(part[1:, 2], part[:-1, 2]) >= 5 - 1e-6
        assert (lifted | (step < 1.01)).all()


def test_every_dip_is_a_pause_that_says_what_to_do() -> None:
    program = gcode(PLAN, actions(), Gcode(), pauses=True)
    dips = [action.done for action in actions() if isinstance(action.done, Dipped)]
    pauses = [line for line in program.splitlines() if line.startswith("M0")]
    assert len(pauses) == len(dips) > 3
    assert pauses[0] == f"M0 (dip into paint 1 {to_hex(PLAN.palette.color[0])})"
    assert pauses[[dip.paint for dip in dips].index(1)].startswith("M0 (clean the brush, then dip into paint 2")
    marlin = gcode(PLAN, actions(), Gcode("marlin"), pauses=True)
    assert f"M0 dip into paint 1 {to_hex(PLAN.palette.color[0])}\n" in marlin and "G94" not in marlin


def test_where_the_wells_are_known_the_machine_dips_itself() -> None:
    choreography = Choreography(Motion(WORKSPACE, CALIBRATION), MEDIUM)
    todo = choreography.actions(PLAN, BrushLoad(), 0, 12)
    program = gcode(PLAN, todo, Gcode(), pauses=False, ending=choreography.cleaning())
    assert "M0" not in program
    places = np.concatenate(travelled(program)) / 1000
    for well in WORKSPACE.wells[:3]:
        assert np.linalg.norm(places - well, axis=1).min() < 0.01
    after_the_last = program.partition("; stroke 12\n")[2]
    assert "; rinse\n" in after_the_last and "; wipe\n" in after_the_last
    assert "; wipe\n" in program and "; stroke 12\n" in program


def test_a_pen_never_goes_below_the_paper() -> None:
    program = gcode(PLAN, actions(flatbed=FlatbedWorkspace(press=0.0)), Gcode(), pauses=True)
    assert min(part[:, 2].min() for part in travelled(program)) == 0


def test_a_servo_writes_no_z_and_refuses_what_it_does_not_reach() -> None:
    servo = Servo((-0.002, 200), (0.005, 900))
    program = gcode(PLAN, actions(), Gcode("grbl", servo=servo), pauses=True)
    assert not re.search(r"^G1.*Z", program, re.M)
    told = [float(value) for value in re.findall(r"S(\d+)", program)]
    assert min(told) >= 200 and max(told) == 900
    with pytest.raises(ConfigError, match=r"height of 5.00 mm; its servo reaches from -2 to 3 mm"):
        gcode(PLAN, actions(), Gcode(servo=Servo((-0.002, 0), (0.003, 90))), pauses=True)


def test_a_plan_without_strokes_is_a_program_that_does_nothing() -> None:
    none = PLAN.part(slice(0))
    assert travelled(gcode(none, actions(none), Gcode(), pauses=True)) == [pytest.approx(np.zeros((1, 3)))]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("press", -0.001),
        ("press", float("nan")),
        ("press", 1.0),
        ("lift", 0.0),
        ("lift", 0.2),
        ("painting_speed", 0.0),
        ("travel_speed", 2.0),
    ],
)
def test_a_desk_that_cannot_be_is_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigError, match="was given"):
        FlatbedWorkspace(**{name: value})


@pytest.mark.parametrize("pauses", [True, False])
def test_between_two_layers_the_machine_waits_for_dry_paint(pauses: bool) -> None:
    layered = in_layers(PLAN, 8, 4)
    lines = gcode(layered, actions(layered), Gcode(), pauses=pauses).splitlines()
    (wait,) = (number for number, line in enumerate(lines) if "let this layer dry for 20 minutes" in line)
    assert lines[wait].startswith("M0 (")
    strokes = [line for line in lines[:wait] if line.startswith("; stroke")]
    assert len(strokes) == 8
    assert "dry" not in gcode(PLAN, actions(), Gcode(), pauses=pauses)


@pytest.mark.parametrize(("seconds", "says"), [(2700.0, "for 45 minutes"), (60.0, "for 1 minute before"), (0.0, None)])
def test_it_waits_as_long_as_paint_is_said_to_dry(seconds: float, says: str | None) -> None:
    layered = in_layers(PLAN, 8, 4)
    program = gcode(layered, actions(layered), Gcode(), pauses=True, drying=seconds)
    assert "clean the brush" in program and ("dry" not in program if says is None else says in program)


@pytest.mark.parametrize("pauses", [True, False])
def test_a_person_is_told_the_ground_and_every_brush_before_it_is_needed(pauses: bool) -> None:
    several = replace(PLAN, ground=(200 / 255, 168 / 255, 120 / 255)).under(
        replace(MORE, layers=(replace(MORE.layers[0], brush="fine"),))
    )
    lines = gcode(several, actions(several), Gcode(), pauses=pauses).splitlines()
    assert any(line.startswith("; ground #c8a878") for line in lines)
    taken = [(number, line) for number, line in enumerate(lines) if line.startswith("M0") and "take the " in line]
    assert ["medium brush" in taken[0][1], "fine brush" in taken[1][1], len(taken)] == [True, True, 2]
    assert taken[0][0] < lines.index("; stroke 1") < taken[1][0] < lines.index("; stroke 13")
    alone = gcode(PLAN, actions(), Gcode(), pauses=pauses)
    assert "take" not in alone and "; ground" not in alone


def test_a_machine_with_a_rack_changes_its_brush_and_waits_for_dry_paint_only() -> None:
    several = PLAN.under(replace(MORE, layers=(replace(MORE.layers[0], brush="fine"),)))
    changes: list[tuple[str, str]] = []

    def change(held: str, brush: str) -> list[Waypoints]:
        changes.append((held, brush))
        return [Waypoints(f"change to {brush}", np.array([[0.0, 0.0, 0.1]]), 0.1)]

    lines = gcode(several, actions(several), Gcode(), pauses=False, change=change).splitlines()
    assert changes == [("", "medium"), ("medium", "fine")]
    assert [line for line in lines if line.startswith("M0")] == [
        "M0 (fill the wells with the paints of layer 2)",
        "M0 (let this layer dry for 20 minutes before the next one)",
    ]
    assert lines.index("; change to medium") < lines.index("; stroke 1") < lines.index("; stroke 12")
    assert lines.index("; stroke 12") < lines.index("; change to fine") < lines.index("; stroke 13")


STRANGE = (
    "a brush of squirrel hair that somebody has named with very many words, as painters do",
    "x" * 200,
    "Pinsel Größe 8 für Öl 画笔 🖌",
    "evil)\nG1 Z-100\r\x18!~?; (\x85\u2028M3 S1000",
)


@pytest.mark.parametrize("flavour", ["grbl", "marlin"])
@pytest.mark.parametrize("pauses", [True, False])
@given(names=st.lists(st.sampled_from(STRANGE) | st.text(max_size=90), min_size=3, max_size=3, unique=True))
@settings(max_examples=25)
def test_no_line_is_long_or_holds_what_a_machine_would_obey(flavour: str, pauses: bool, names: list[str]) -> None:
    plan = replace(PLAN, ground=(0.2, 0.1, 0.1), layers=(replace(PLAN.layers[0], brush="fine"),))
    for seed in range(2):
        plan = plan.under(replace(MORE, layers=(replace(MORE.layers[0], brush=f"b{seed}"),)))
    todo = actions(replace(plan, layers=tuple(replace(layer, brush="fine") for layer in plan.layers)))
    named = replace(plan, layers=tuple(map(lambda layer, name: replace(layer, brush=name), plan.layers, names)))
    program = gcode(named, todo, Gcode(flavour), pauses=pauses, drying=86399.0)
    lines = program.split("\n")
    assert max(map(len, lines)) <= 70
    assert all(" " <= sign <= "~" for line in lines for sign in line)
    assert not set(program) & set("!?~")
    for line in lines:
        code, _, said = line.partition(";")
        assert ";" not in said and not (code and said)
        if line.startswith("M0 ") and flavour == "grbl":
            assert re.fullmatch(r"M0 \([^()]+\)", line)
        elif code:
            assert re.fullmatch(r"(G1|G2[01]|G9[04]|M0 )[^()]*", code)
    assert [line for line in lines if re.match("G[0-9]", line)] == [
        line for line in gcode(plan, todo, Gcode(flavour), pauses=pauses).split("\n") if re.match("G[0-9]", line)
    ], "names change nothing that moves"


def test_what_does_not_fit_on_one_line_is_a_pause_each_and_nothing_of_it_is_lost() -> None:
    several = PLAN.under(replace(MORE, layers=(replace(MORE.layers[0], brush="fine"),)))
    lines = gcode(several, actions(several), Gcode("marlin"), pauses=True).splitlines()
    begins = lines.index("; stroke 13")
    waits = [line for line in lines[lines.index("; stroke 12") : begins] if line.startswith("M0")]
    assert waits[:3] == [
        "M0 clean the brush, take the fine brush",
        "M0 fill the wells with the paints of layer 2",
        "M0 let this layer dry for 20 minutes before the next one",
    ]
