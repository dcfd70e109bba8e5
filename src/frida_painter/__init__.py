"""FRIDA painter: a robot that paints with people."""
