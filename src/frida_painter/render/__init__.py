"""The differentiable renderer: from strokes to the picture that they would paint."""
