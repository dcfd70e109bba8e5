"""What this studio can be asked for: which kinds of goals there are, and what is missing for the others."""

from frida_painter.model_folder import are_here
from frida_painter.web.wish import Kind

# Which weights each kind of goal needs: one of each group.
_NEEDED: dict[Kind, tuple[tuple[str, ...], ...]] = {
    "image": (),
    "style": (("vgg16", "hed"),),
    "semantic": (("efficientnet-lite0",),),
    "sketch": (("hed",),),
    "text": (("minilm",), ("efficientnet-lite0",)),
}


def abilities() -> dict[str, dict[str, object]]:
    """For each kind of goal: whether it is ready, which weights are missing, and a sentence on how to get them."""
    return {kind: _ability(groups) for kind, groups in _NEEDED.items()}


def _ability(groups: tuple[tuple[str, ...], ...]) -> dict[str, object]:
    missing = [group[-1] for group in groups if not any(map(are_here, group))]
    advice = f"This needs a network that is not here yet; fetch it with: frida-painter models fetch {' '.join(missing)}"
    return {"ready": not missing, "missing": missing, "advice": advice if missing else ""}
