"""A robot, a camera and a stroke model of your own, as a package beside FRIDA painter."""
