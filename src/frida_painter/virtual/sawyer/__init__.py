"""The paper's robot, a Rethink Sawyer, physically simulated: it paints in the virtual studio as an arm does."""
