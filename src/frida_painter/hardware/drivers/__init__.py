"""Robots by their makers: one thin file per device, none of which knows that it paints."""
