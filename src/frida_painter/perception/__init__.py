"""Perception: from a photograph of the easel to a rectified picture of the canvas in true colours."""
