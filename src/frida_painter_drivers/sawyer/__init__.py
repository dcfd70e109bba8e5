"""The paper's robot arm, a Rethink Sawyer, simulated with its weight and its friction."""
