"""The calibration procedures: each one is a dialogue with the person at the easel, in the module of its name.

    def robot(easel: Easel, ...) -> Procedure[Finding]

Its easel has a connected robot and camera, and `easel.calibration` contains the parts of earlier procedures. A
procedure asks by yielding the questions of `easel.dialogue`, with a proposal if it has one. It raises CalibrationError,
with a sentence that says what to do, instead of returning a wrong result. It changes no calibration: its finding can
enter itself into one. Photographs and motions go through `paper.EaselAccess` and the gateway.

`calibrating.calibrate_one` leads the dialogue, enters the finding and saves the record.
"""
