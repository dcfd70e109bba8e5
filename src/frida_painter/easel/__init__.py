"""The easel: a robot with its camera, opened and supervised in a separate process."""
