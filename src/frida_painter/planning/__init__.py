"""The planner: where strokes start, how they are optimised, and how they become a plan."""
