"""A picture maker that begins from the canvas."""

BOAT = """
import sys
from PIL import Image, ImageDraw
seed, canvas, out = sys.argv[1:4]
picture = Image.open(canvas).convert("RGB") if canvas else Image.new("RGB", (96, 72), (120, 170, 220))
wide, high = picture.size
bow = (0.3 + 0.1 * (int(seed) % 4)) * wide
hull = [(bow, 0.6 * high), (bow + 0.3 * wide, 0.6 * high), (bow + 0.15 * wide, 0.8 * high)]
ImageDraw.Draw(picture).polygon(hull, "red")
picture.save(out, "PNG")
"""
"""A maker that draws a boat onto the picture that it gets."""
