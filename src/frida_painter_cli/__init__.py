"""Command line: reads options, calls the library and shows results."""
