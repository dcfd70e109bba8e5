"""How much the strokes procedure may be asked to paint: read without loading the procedure."""

MOST_STROKES = 10_000
MOST_BETWEEN_REFILLS = 100
"""Strokes painted with one dip."""
