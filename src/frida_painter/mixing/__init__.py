"""Mixing: how much of which paint that a person owns gives a colour, by Kubelka and Munk's theory."""
