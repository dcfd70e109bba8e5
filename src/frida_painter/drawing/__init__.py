"""Drawing of scenes: places, lights, figures and other things, and how they are put together."""
