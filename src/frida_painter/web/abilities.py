"""What this studio can be asked for: which kinds of goals there are, and what is missing for the others."""

from frida_painter.model_folder import are_here
from frida_painter.objectives.registry import goal_kinds


def abilities() -> dict[str, dict[str, object]]:
    """For each kind of goal: whether it is ready, which weights are missing, and a sentence on how to get them."""
    return {name: _ability(kind.networks) for name, kind in goal_kinds().by_name.items()}


def _ability(groups: tuple[tuple[str, ...], ...]) -> dict[str, object]:
    missing = [group[-1] for group in groups if not any(map(are_here, group))]
    advice = f"This needs a network that is not here yet; fetch it with: frida-painter models fetch {' '.join(missing)}"
    return {"ready": not missing, "missing": missing, "advice": advice if missing else ""}
