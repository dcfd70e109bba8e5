"""Files, pictures, processes and devices of this computer."""
