"""Text prompts: a prompt becomes an initial picture, composed from picture libraries."""
