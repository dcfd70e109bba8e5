"""The painter's sight: from the photograph of an easel to the canvas as it is, straight on and in true colours."""
