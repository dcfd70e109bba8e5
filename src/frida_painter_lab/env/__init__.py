"""Environments of gymnasium in which programs learn to paint: the virtual studio, and the renderer alone.

    import gymnasium
    import frida_painter_lab.env
    env = gymnasium.make("studio/strokes-v1", canvas="20x16cm", paints=4)

`studio/strokes-v1`: one stroke an action, then a look, in the virtual studio (studio_env.py)
`studio/plans-v1`: a batch of strokes an action, then a look
`renderer/strokes-v1`: the renderer without robot, camera and wet paint, thousands of strokes a second (renderer_env.py)

All have the same observations and the same strokes (task.py, actions.py). An edge: the core imports none of this.
This file registers the environments, as gymnasium wants it of a package; it loads nothing else.
"""

from typing import TYPE_CHECKING, Any

from frida_painter import registry
from frida_painter.system.python_process import prepare_forks

if TYPE_CHECKING:
    import gymnasium
    from gymnasium.vector import VectorEnv

STUDIO_STROKES, STUDIO_PLANS, RENDERER_STROKES = "studio/strokes-v1", "studio/plans-v1", "renderer/strokes-v1"
IDS = (STUDIO_STROKES, STUDIO_PLANS, RENDERER_STROKES)
"""Names of the environments."""
SETTINGS = ("canvas", "brush", "paints", "goal", "strokes", "minutes", "judge", "rows", "ground", "seed", "render_mode")
"""Settings of all environments (task.py)."""
_ROOM = "frida_painter_lab.env"


def register() -> None:
    """Registers the environments with gymnasium, if they are not registered yet.

    Processes that are forked from this one, as by AsyncVectorEnv, compute with one thread each.
    """
    import gymnasium

    prepare_forks()

    kinds: dict[str, dict[str, Any]] = {
        STUDIO_STROKES: {"entry_point": f"{_ROOM}.studio_env:StudioEnv"},
        STUDIO_PLANS: {"entry_point": f"{_ROOM}.studio_env:StudioEnv", "kwargs": {"batch": 10}},
        RENDERER_STROKES: {
            "entry_point": f"{_ROOM}.renderer_env:RendererEnv",
            "vector_entry_point": f"{_ROOM}.renderer_env:RendererVectorEnv",
        },
    }
    for name, kind in kinds.items():
        if name not in gymnasium.registry:
            # Each of them checks its actions itself, and refuses a step after the end.
            gymnasium.register(name, **kind, order_enforce=False, disable_env_checker=True)


def make_env(name: str, *, num_envs: int | None = None, **settings: Any) -> "gymnasium.Env[Any, Any] | VectorEnv":
    """Returns an environment of gymnasium.

    name: studio/strokes-v1, studio/plans-v1 or renderer/strokes-v1.
    num_envs: number of copies in one vector environment. None: a single one.
    settings: canvas, paints, goal, brush, strokes, minutes, judge, rows, ground, seed (env/task.py), batch and
    render_mode.
    Raises ConfigError if the name or a setting is wrong, or the extra "env" is not installed.

        >>> import frida_painter as fp
        >>> env = fp.make_env("renderer/strokes-v1", canvas="12x9cm", paints=["#222", "#a33"], seed=0)
        >>> observation, info = env.reset()
        >>> observation, reward, ended, cut, info = env.step(env.action_space.sample())
        >>> observation["canvas"].shape
        (64, 85, 3)
    """
    from frida_painter.errors import ConfigError

    registry.require("env", "gymnasium", "An environment")
    import gymnasium

    register()
    if name not in IDS:
        raise ConfigError(f"There is no environment {str(name)[:60]!r}; take {', '.join(IDS)}.")
    known = {*SETTINGS, *(["batch"] if name == STUDIO_PLANS else [])}
    if unknown := sorted(settings.keys() - known):
        raise ConfigError(f"{name} has no setting {unknown[0][:40]!r}; it has {', '.join(sorted(known))}.")
    if num_envs is None:
        return gymnasium.make(name, **settings)
    from frida_painter_lab.env.task import require_whole

    require_whole("num_envs", num_envs, 1, 4096)
    return gymnasium.make_vec(name, num_envs, **settings)


if registry.is_installed("gymnasium"):
    register()
