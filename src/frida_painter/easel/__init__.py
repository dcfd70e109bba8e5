"""The easel: a machine with its camera, opened and watched in a process of its own."""
