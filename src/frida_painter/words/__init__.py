"""Text prompts: what they say becomes a picture to begin with, composed from picture libraries."""
