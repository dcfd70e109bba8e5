"""The whole easels that ship with the project, one file for each."""
