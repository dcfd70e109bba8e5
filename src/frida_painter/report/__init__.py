"""What a person sees afterwards: film, palette sheet, page."""
