"""Commands of calibration: setup, calibrate, doctor, parts, arm, strokes, teach."""
