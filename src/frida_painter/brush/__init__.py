"""Brushes: their trajectories, stroke libraries, and models of the marks that they leave."""


# Limits of stroke libraries and names of stroke models, readable without the training code.

MAX_STROKES = 10_000
MAX_BETWEEN_REFILLS = 100
"""Largest number of strokes painted with one dip."""
FEWEST_STROKES = 5
"""Smallest number of clean strokes for training."""
FIELD, PARAM2STROKE = "field", "param2stroke"
MODELS = (FIELD, PARAM2STROKE)
"""Names of the stroke models that can be trained."""
DEFAULT_MODEL = FIELD
