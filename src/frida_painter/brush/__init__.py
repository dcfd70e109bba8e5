"""The brush: its trajectory, and models of the mark that it leaves."""


# How many strokes a library may have, and what is learned of them: read without loading anything that learns.

MOST_STROKES = 10_000
MOST_BETWEEN_REFILLS = 100
"""Strokes painted with one dip."""
FEWEST_STROKES = 5
"""Clean strokes that training needs."""
MOST_FOLDS = 20
"""Parts of a library that cross-validation tests in turn."""
FIELD, PARAM2STROKE = "field", "param2stroke"
MODELS = (FIELD, PARAM2STROKE)
"""Names of the stroke models that can be trained."""
DEFAULT_MODEL = FIELD
