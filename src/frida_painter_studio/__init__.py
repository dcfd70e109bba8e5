"""Studio: a web page on which a person and the robot paint together."""
