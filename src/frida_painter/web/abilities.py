"""What this studio can be asked for: which kinds of goals there are, and what is missing for the others."""

from frida_painter import extras
from frida_painter.model_folder import are_here
from frida_painter.objectives.kind import goal_kinds

# Which extra a kind of goal needs beside its networks, and a package of it.
_EXTRAS = {"text": ("words", "transformers")}


def abilities() -> dict[str, dict[str, object]]:
    """For each kind of goal: whether it is ready, which weights are missing, what to fetch, and a sentence on that."""
    return {name: _ability(name, kind.networks) for name, kind in goal_kinds().by_name.items()}


def _ability(kind: str, groups: tuple[tuple[str, ...], ...]) -> dict[str, object]:
    missing = [group[-1] for group in groups if not any(map(are_here, group))]
    fetch = ["words"] if kind == "text" and missing else missing
    said = []
    if kind in _EXTRAS and not extras.is_installed(_EXTRAS[kind][1]):
        said.append(extras.advice(_EXTRAS[kind][0], "This"))
    if missing:
        command = f"frida-painter models fetch {' '.join(fetch)}"
        said.append(f"This needs a network that is not here yet; fetch it with: {command}")
    return {"ready": not said, "missing": missing, "fetch": fetch, "advice": ". ".join(said)}
