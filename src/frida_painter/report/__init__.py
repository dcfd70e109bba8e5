"""Reports of a painting: film, sheets to print, and page."""
