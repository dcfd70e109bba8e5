"""Seeing: from photographs to the canvas, its colours and whether they can be trusted."""
