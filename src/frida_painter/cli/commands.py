"""All commands of the command line, by name; docs and the list of commands show them in this order."""

from frida_painter.cli.deferred import Deferred

_CLI = "frida_painter.cli"

COMMANDS = (
    Deferred(
        "paint",
        f"{_CLI}.painting",
        "Paint a photograph, or words: plan, paint some strokes, look, plan the rest again.",
    ),
    Deferred(
        "plan",
        f"{_CLI}.painting",
        "Plan the strokes for a photograph, or for words, without painting: plan, picture of it, palette to mix.",
    ),
    Deferred(
        "render", f"{_CLI}.painting", "Draw a plan as a picture of any size, as the simulation of the brush sees it."
    ),
    Deferred("resume", f"{_CLI}.resume", "Go on with a painting that was stopped or broke off, from its folder."),
    Deferred("export", f"{_CLI}.export", "Write the strokes of a plan in millimetres."),
    Deferred(
        "calibrate",
        f"{_CLI}.calibrate",
        "Get to know an easel: where its canvas is, where its robot paints, how its camera sees, what its brush does.",
    ),
    Deferred(
        "doctor",
        f"{_CLI}.calibrate",
        "Tell how the easel's calibration stands: what was done when and how well, and what to repeat.",
    ),
    Deferred("arm", f"{_CLI}.arm", "Let a robot move again that was stopped, once you have looked at it."),
    Deferred("check", f"{_CLI}.check", "Check whether a whole plan can be painted on an easel, before anything moves."),
    Deferred(
        "mix",
        f"{_CLI}.mix",
        "Tell how to mix each colour of a palette: parts of the paints you own, and how near they come.",
    ),
    Deferred(
        "studio",
        "frida_painter.web.command",
        "Open the studio: a page on which you say what to paint, see the plan, and paint together with the robot.",
    ),
    Deferred("workspace", f"{_CLI}.check", "Write down where canvas, wells, water and rag stand, in metres."),
    Deferred("strokes", f"{_CLI}.strokes", "Teach the painter its brush from strokes that it has painted."),
    Deferred("models", f"{_CLI}.models", "Get the networks that words, styles and meanings are painted by."),
    Deferred(
        "experiments",
        "frida_painter.experiments.command",
        "The paper's figures and tables, and ours, each one command that measures anew.",
    ),
)
