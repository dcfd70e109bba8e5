"""The benchmark of robot painting: a frozen suite, entrants, hand-ins of other systems, judges and the table."""
