"""What may be learned from how many strokes, and by which models: read without loading anything that learns."""

FEWEST_STROKES = 5
"""Clean strokes that training needs."""
MOST_FOLDS = 20
"""Parts of a library that cross-validation tests in turn."""
FIELD, PARAM2STROKE = "field", "param2stroke"
MODELS = (FIELD, PARAM2STROKE)
"""Names of the stroke models that can be trained."""
DEFAULT_MODEL = FIELD
