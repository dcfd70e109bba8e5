"""A person and the robot on one canvas: turns, pen strokes, and policies for the robot's answer."""
