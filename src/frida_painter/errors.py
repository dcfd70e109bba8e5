"""One tree of errors: every message says what was given, what is allowed, and what to do."""


class FridaError(Exception):
    """Anything that a painter can mend; the command line prints its one sentence and exits with status 2."""


class ConfigError(FridaError):
    """Settings that are missing, unknown, of the wrong kind or out of range; names all of them at once."""


class PluginError(ConfigError):
    """A part that another package registers and that cannot be used; names the part and the package."""


class ImageError(FridaError):
    """A picture that cannot be read as an image in [0, 1], or is too small or too large."""


class StorageError(FridaError):
    """A file or folder that cannot be written or read as it must be (full, read-only, damaged)."""


class PlanError(FridaError):
    """A plan that is damaged, edited, of a future version, or whose strokes break their limits."""


class PlanningDiverged(FridaError):
    """The optimiser kept producing losses or gradients that are not finite; the best plan so far is kept."""


class WeightsError(FridaError):
    """Weights of a network that are missing, altered, of the wrong shape or not finite."""


class LibraryError(FridaError):
    """A stroke library that is damaged, empty, or not a stroke library."""


class CalibrationError(FridaError):
    """A calibration record that is damaged, foreign, out of date, or a fit that must be repeated."""


class RobotError(FridaError):
    """The robot refused, failed or vanished; nothing moves until a person has looked."""


class WorkspaceViolation(RobotError):
    """A waypoint outside the workspace; names the motion and the axis, and nothing of the batch was sent."""


class RobotDisconnected(RobotError):
    """The robot does not answer; nothing reconnects and moves on by itself."""


class RobotStopped(RobotError):
    """The robot was stopped and stays so until a person has looked and re-arms it.

    asked: whether a person asked for it while the painting was under way (the stop file), which is no fault.
    """

    def __init__(self, message: str, *, asked: bool = False) -> None:
        super().__init__(message)
        self.asked = asked


class RobotBusy(RobotError):
    """Another process has the robot; pid: its number, None where not known."""

    def __init__(self, message: str, pid: int | None = None) -> None:
        super().__init__(message)
        self.pid = pid


class MotionFailed(RobotError):
    """A motion ended in an error, which is never cleared by the program.

    code: the robot's own for it; waypoint: the index of the one on whose way it happened; None where not known.
    """

    def __init__(self, message: str, code: int | str | None = None, waypoint: int | None = None) -> None:
        super().__init__(message)
        self.code, self.waypoint = code, waypoint


class PoseMismatch(RobotError):
    """The robot says that it arrived, and its pose says otherwise."""


class CameraError(FridaError):
    """The camera cannot be reached or its pictures cannot be used."""


class StaleFrame(CameraError):
    """A frame older than the last motion; no decision is made from it."""


class FrameRejected(CameraError):
    """A fresh frame that does not show the canvas as it should; the message gives the reason."""


class FrameDoubtful(FrameRejected):
    """A fresh frame of which nobody can tell by itself whether it shows the canvas as it should: a person can."""


class PaintingPaused(FridaError):
    """A painting could not go on by itself and nobody was there to ask; it can be resumed where it is."""


class SweepBusy(FridaError):
    """Another process works on this sweep."""


class WorkerUnfit(FridaError):
    """A process or machine that cannot do any run of a sweep, which stops there; what was done is kept."""


class TryFailed(FridaError):
    """A run of a sweep that failed, hung or was killed; it is tried again, and then reported."""


class Interrupted(FridaError):
    """A person asked to stop; what was made so far is kept."""
