"""Telling a lack of memory from other failures: processors and their libraries each say it in their own way."""

_SAID = ("out of memory", "not enough memory", "can't allocate memory", "cannot allocate memory")


def is_lack_of_memory(failure: Exception) -> bool:
    """Whether an exception says that there was not memory enough, on the machine or on its accelerator."""
    return isinstance(failure, MemoryError) or any(words in str(failure).lower() for words in _SAID)
