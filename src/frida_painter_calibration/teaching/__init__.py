"""Teaching: stroke models learned from painted strokes, and families of strokes that a person taught."""
