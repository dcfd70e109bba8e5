"""Where a machine's state is kept between runs."""

from pathlib import Path

from platformdirs import user_state_path


def state_folder() -> Path:
    """Where stops are latched and robots locked when nobody says otherwise."""
    return user_state_path("frida-painter", appauthor=False)
