"""Text prompts: a prompt becomes an initial picture, composed from picture libraries."""

from frida_painter.objectives.objective import Gives, GoalKind
from frida_painter.registry import Later

TEXT = GoalKind(
    name="text",
    gives=Gives.WORDS,
    help='A text prompt: what to paint, like "a sailing ship".',
    label="Words",
    open=Later("frida_painter_words.text:TextTerm"),
    initial_help="A text prompt to start from. The painting keeps its composition.",
    networks=(("clip-vit-b-32", "minilm"),),
)
