"""The brush: its trajectory, and models of the mark that it leaves."""
