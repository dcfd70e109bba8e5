"""Process that fetches a diffusion pipeline from the hub."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from frida_painter.picture_makers.child import run_task, tell
from frida_painter.weights.pipeline_folder import fetch_pipeline


def _fetch(task: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Returns the folder of the fetched pipeline in the cache. Raises like `fetch_pipeline`.

    task: name on the hub
    """
    return {"folder": str(fetch_pipeline(task["name"], tell).folder)}


if __name__ == "__main__":
    run_task(_fetch, "The download")
