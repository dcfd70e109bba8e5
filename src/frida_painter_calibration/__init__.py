"""Calibration of an easel: procedures, stroke models that are learned, setup of machines."""
