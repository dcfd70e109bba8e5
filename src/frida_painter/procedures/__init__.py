"""The calibration procedures: each a conversation with whoever stands at the easel.

A procedure `name` is a generator function of that name in the module of that name:

    def robot(easel: Easel, ...) -> Procedure[RobotFinding]

It gets an easel whose robot and camera are connected and whose `easel.calibration` is the record so
far, with the parts of earlier procedures in place; everything else has a default or is a keyword.
It asks by yielding the questions of `dialogue`, always with a proposal where it can make one, and
raises CalibrationError, with a sentence that says what to do, instead of returning something that
is wrong. It changes no record: it returns a frozen `dialogue.Finding`, which knows how to enter
itself into one. `at_the_easel` photographs, and moves the robot through the gateway. Whoever leads
the dialogue (`dialogue.lead`) enters the finding and saves the record; the command line lists the
procedures in `cli.calibrate`.
"""
