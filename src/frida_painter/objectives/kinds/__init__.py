"""The kinds of goals that ship with the project: one file each, which says all of it."""
