"""Pictures for words: what a prompt says, pictures of the things in it, and a scene composed of them."""
