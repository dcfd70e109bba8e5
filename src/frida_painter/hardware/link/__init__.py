"""The link between a painting's process and its easel's: requests and reports on one line, stop on another."""
