"""Errors of the project. Each message says what was given, what is allowed, and what to do."""


class FridaError(Exception):
    """Base of all errors that a user can fix. The command line prints the message and exits with status 2.

    One `except` catches them all:

        >>> import frida_painter as fp
        >>> try:
        ...     fp.load_picture("no-such-picture.jpg")
        ... except fp.FridaError as error:
        ...     print(type(error).__name__)
        ImageError
    """


class ConfigError(FridaError):
    """Settings that are missing, unknown, of the wrong type or out of range; the message names all of them."""


class PluginError(ConfigError):
    """Part of another package that cannot be used; the message names the part and the package."""


class ImageError(FridaError):
    """Picture that cannot be read as an image in [0, 1], or is too small or too large."""


class MakingFailed(FridaError):
    """Picture maker that failed, took too long, or made nothing that can be painted."""


class StorageError(FridaError):
    """File or folder that cannot be written or read (full disk, read-only, damaged)."""


class PlanError(FridaError):
    """Plan that is damaged, edited or of a newer version, or whose strokes break their limits."""


class HandInError(FridaError):
    """Strokes of another system that cannot be painted as they are; the message names the stroke or the line."""


class StepRefused(FridaError):
    """Step of an environment that was refused: an action outside its space, or no reset before; nothing is painted."""


class PlanningDiverged(FridaError):
    """Repeated losses or gradients that are not finite; the best plan so far is kept."""


class WeightsError(FridaError):
    """Network weights that are missing, altered, of the wrong shape or not finite."""


class FamilyError(FridaError):
    """Marks that no stroke family can be learned from, or a damaged or foreign file of a stroke family."""


class LibraryError(FridaError):
    """Stroke library that is damaged or empty, or a file that is no stroke library."""


class CalibrationError(FridaError):
    """Calibration record that is damaged, foreign or out of date, or a fit that must be repeated."""


class RobotError(FridaError):
    """Robot that refused a command, failed or disconnected; nothing moves until a person has looked."""


class WorkspaceViolation(RobotError):
    """Waypoint outside the workspace. The message names motion and axis; nothing of the batch was sent."""


class RobotDisconnected(RobotError):
    """Robot that does not answer. The program does not reconnect and continue by itself."""


class RobotAbandoned(RobotDisconnected):
    """Robot whose easel's process is gone, for example because the system was out of memory.

    held: True if its board got a stop all the same, over the second descriptor of its line
    latched: True if the stop is stored, so that nothing moves until a person arms the robot
    """

    def __init__(self, message: str, *, held: bool, latched: bool) -> None:
        super().__init__(message)
        self.held, self.latched = held, latched


class RobotStopped(RobotError):
    """Robot that was stopped. It stays stopped until a person has looked and re-arms it.

    asked: True if a person requested the stop during the painting (the stop file), so it is no fault
    """

    def __init__(self, message: str, *, asked: bool = False) -> None:
        super().__init__(message)
        self.asked = asked


class RobotBusy(RobotError):
    """Robot that another process holds.

    pid: number of that process; None if unknown
    """

    def __init__(self, message: str, pid: int | None = None) -> None:
        super().__init__(message)
        self.pid = pid


class ZeroUnknown(RobotError):
    """Machine that does not know where it stands; it does not paint until its zero is found again."""


class MotionFailed(RobotError):
    """Motion that ended in an error; the program never clears that error.

    code: error code of the robot; None if unknown
    waypoint: index of the waypoint that the robot was moving to; None if unknown
    """

    def __init__(self, message: str, code: int | str | None = None, waypoint: int | None = None) -> None:
        super().__init__(message)
        self.code, self.waypoint = code, waypoint


class PoseMismatch(RobotError):
    """Robot that reports arrival with a pose that is not the target."""


class CameraError(FridaError):
    """Camera that cannot be reached, or whose pictures cannot be used."""


class StaleFrame(CameraError):
    """Camera frame older than the last motion; no decision is made from it."""


class FrameRejected(CameraError):
    """New camera frame that does not show the canvas properly; the message gives the reason."""


class FrameDoubtful(FrameRejected):
    """New camera frame that the program cannot judge; a person must decide."""


class PaintingPaused(FridaError):
    """Painting that needs a decision while no person is there; it can be resumed."""


class SweepBusy(FridaError):
    """Sweep that another process works on."""


class WorkerUnfit(FridaError):
    """Process or machine that cannot do any run of a sweep. The sweep stops there; finished runs are kept."""


class TryFailed(FridaError):
    """Run of a sweep that failed, hung or was killed. It is tried again, and then reported."""


class ProcessLost(FridaError):
    """Process of the painter that was killed or failed, or did not answer in time; it can be started again."""


class Interrupted(FridaError):
    """Stop request of a person; the results so far are kept."""
