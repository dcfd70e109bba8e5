"""Forms of events: a moment carries plans and pixels, a written event is plain data with a JSON form."""

from dataclasses import dataclass
from typing import dataclass_transform


@dataclass_transform(frozen_default=True)
@dataclass(frozen=True)
class Event:
    """Something that happens in a painting or a calibration; every class of events is a frozen dataclass."""

    def __init_subclass__(cls) -> None:
        dataclass(frozen=True)(cls)


class Moment(Event):
    """Event that carries plans and pixels, and stays inside the painting process."""


class Written(Event):
    """Event of the journal, of the feed of the studio page, or of both; it names pictures by their files."""
