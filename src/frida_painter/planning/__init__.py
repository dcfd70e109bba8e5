"""Planner: places strokes, optimises them and turns them into a plan."""
