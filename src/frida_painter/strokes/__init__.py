"""Strokes, their families, paints and order: the nouns of a plan."""
