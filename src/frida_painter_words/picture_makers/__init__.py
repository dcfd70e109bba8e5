"""Picture makers of this project: programs, services and networks that make a picture from words."""
