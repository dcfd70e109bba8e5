"""Plans in the formats of other programs: SVG and CSV."""
