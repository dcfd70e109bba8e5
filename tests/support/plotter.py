"""The workspace of a small plotter, as a person writes it."""

PLOTTER = """
easel = "a plotter"
[bounds]
lower = [0.0, -0.25, -0.002]
upper = [0.3, 0.0, 0.010]
[canvas]
width = 0.14
height = 0.1
corner = [0.1, -0.15, 0.0]
turn = 0.0
[brush]
touch_height = 0.0
press_height = -0.002
[paint]
wells = [[0.03, -0.05, -0.001], [0.06, -0.05, -0.001]]
water = [0.03, -0.10, -0.001]
rag = [0.05, -0.15, 0.0]
rag_width = 0.04
[motion]
hover = 0.006
painting_speed = 0.06
travel_speed = 0.15
home = [0.0, 0.0, 0.010]
"""
