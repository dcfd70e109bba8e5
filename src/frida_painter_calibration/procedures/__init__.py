"""The calibration procedures: each one is a dialogue with the person at the easel.

A procedure `name` is a generator function of that name in the module of that name:

    def robot(easel: Easel, ...) -> Procedure[RobotFinding]

Its easel has a connected robot and camera. `easel.calibration` already contains the parts of earlier procedures.
All other parameters have defaults or are keywords.

A procedure asks by yielding the questions of `easel.dialogue`, with a proposal if it has one. It raises
CalibrationError, with a sentence that says what to do, instead of returning a wrong result. It changes no
calibration: it returns a frozen `dialogue.Finding`, which can enter itself into one. Photographs and motions go
through `paper.EaselAccess` and the gateway.

The caller of the dialogue (`dialogue.lead`) enters the finding and saves the calibration. The command line lists
the procedures in `cli.calibrate`.
"""
