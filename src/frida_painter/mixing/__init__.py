"""Mixing recipes: amounts of a person's paints for a colour, by the theory of Kubelka and Munk."""
