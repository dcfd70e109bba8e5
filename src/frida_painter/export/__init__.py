"""Plans in the formats of other programs: G-code, SVG and CSV."""
