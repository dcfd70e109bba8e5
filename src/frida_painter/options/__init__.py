"""How settings are given on a command line: what the commands of all faces share."""
