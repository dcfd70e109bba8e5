"""All commands of the command line, by name; docs and the list of commands show them in this order."""

from frida_painter.cli.deferred import Deferred

_CLI = "frida_painter.cli"

COMMANDS = (
    Deferred(
        "paint",
        f"{_CLI}.painting",
        "Paint a photograph or a text prompt. Plans, paints some strokes, looks at the canvas and replans the rest.",
    ),
    Deferred(
        "plan",
        f"{_CLI}.painting",
        "Plan the strokes without painting. Writes the plan, a picture of the plan and the palette to mix.",
    ),
    Deferred(
        "render", f"{_CLI}.painting", "Render a plan as a picture of any size, with the stroke models of its brushes."
    ),
    Deferred("resume", f"{_CLI}.resume", "Continue a painting that was stopped, paused or killed, from its folder."),
    Deferred("export", f"{_CLI}.export", "Export the strokes of a plan as SVG, G-code or CSV, in millimetres."),
    Deferred(
        "calibrate",
        f"{_CLI}.calibrate",
        "Calibrate an easel: the position of the canvas, the robot, the camera's colours, the brush and its strokes.",
    ),
    Deferred(
        "doctor",
        f"{_CLI}.calibrate",
        "Show the state of the calibration and what to repeat, and the robots, cameras and stroke models there are.",
    ),
    Deferred("arm", f"{_CLI}.arm", "Allow a robot to move again after a stop. Look at the robot first."),
    Deferred(
        "check",
        f"{_CLI}.check",
        "Check whether a robot can paint a whole plan on an easel, and how long it takes. Nothing moves.",
    ),
    Deferred(
        "mix",
        f"{_CLI}.mix",
        "Give a recipe for each colour of a palette, from the paints that you own, with the predicted error.",
    ),
    Deferred(
        "studio",
        "frida_painter.web.command",
        "Open the studio, a web page on which you set the goal, see the plan and paint together with the robot.",
    ),
    Deferred(
        "workspace",
        f"{_CLI}.check",
        "Describe the workspace of a robot: where canvas, wells, water and rag stand, in metres.",
    ),
    Deferred("strokes", f"{_CLI}.strokes", "Collect a library of strokes, and train and test stroke models on it."),
    Deferred(
        "models", f"{_CLI}.models", "Download the networks for text, styles and sketches, and show which are here."
    ),
    Deferred(
        "sweep",
        f"{_CLI}.sweep",
        "Do many runs: every combination of photographs, text, seeds and settings in a sweep file.",
    ),
    Deferred(
        "experiments",
        "frida_painter.experiments.command",
        "Run the experiments of the paper and more. Each command measures anew and writes tables and pictures.",
    ),
)
