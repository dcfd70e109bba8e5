"""How goals are given on the command line."""

from inspect import Parameter
from pathlib import Path
from typing import Annotated, Any

import typer

from frida_painter.cli.numbers import number

_Files = list[Path] | None
_Words = list[str] | None
_Weights = list[float] | None
_PANEL = "What to paint"


def _file(text: str) -> Any:
    return typer.Option(metavar="FILE", help=f"{text} May be repeated.", rich_help_panel=_PANEL)


def _words(text: str) -> Any:
    return typer.Option(metavar="WORDS", help=f"{text} May be repeated.", rich_help_panel=_PANEL)


def _weight(kind: str) -> Any:
    text = f"How much each --{kind} matters, in their order. [dim]1[/]"
    return typer.Option(parser=number, metavar="X", help=text, rich_help_panel=_PANEL)


Text = Annotated[_Words, _words('What to paint, in words, such as "a sailing ship".')]
TextWeight = Annotated[_Weights, _weight("text")]
Image = Annotated[_Files, _file("A further picture to come near to, pixel by pixel.")]
ImageWeight = Annotated[_Weights, _weight("image")]
Style = Annotated[_Files, _file("A picture whose colours, textures and marks the painting shall have.")]
StyleWeight = Annotated[_Weights, _weight("style")]
Semantic = Annotated[_Files, _file("A picture to paint by what it shows, rather than pixel by pixel.")]
SemanticWeight = Annotated[_Weights, _weight("semantic")]
Sketch = Annotated[_Files, _file("A drawing whose lines the painting shall follow: lines on paper, or on nothing.")]
SketchWeight = Annotated[_Weights, _weight("sketch")]
InitImage = Annotated[_Files, _file("A picture to begin with, whose composition shall stay.")]
InitStyle = Annotated[_Files, _file("A style picture to begin with: its composition is kept as well.")]
InitText = Annotated[_Words, _words("Words to begin with, whose composition shall stay.")]
GoalFile = Annotated[
    Path | None,
    typer.Option("--goal", metavar="FILE", help="A TOML file with goals and weights.", rich_help_panel=_PANEL),
]
ClipSource = Annotated[
    str | None,
    typer.Option(
        "--clip",
        metavar="NAME|FOLDER",
        help="The CLIP that words and meaning are seen through: a name on the hub, a folder, or a safetensors file of "
        "its ResNet kind. [dim]clip-vit-b-32 where it was fetched, or else smaller networks[/]",
        rich_help_panel=_PANEL,
    ),
]


def parameters() -> list[Parameter]:
    """The options of all kinds of goals, in the order in which help shows them."""
    options = {
        "image": Image,
        "image_weight": ImageWeight,
        "semantic": Semantic,
        "semantic_weight": SemanticWeight,
        "sketch": Sketch,
        "sketch_weight": SketchWeight,
        "text": Text,
        "text_weight": TextWeight,
        "style": Style,
        "style_weight": StyleWeight,
        "init_text": InitText,
        "init_image": InitImage,
        "init_style": InitStyle,
        "goal": GoalFile,
        "clip": ClipSource,
    }
    return [
        Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
        for name, annotation in options.items()
    ]
