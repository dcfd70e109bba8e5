"""One painting as a run: its description, its execution and its folder."""
