"""The virtual studio: a simulated reality of bristles, paint, canvas, robot and camera."""
