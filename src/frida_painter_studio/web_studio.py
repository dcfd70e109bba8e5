"""Studio: its paintings, workers, queue and streams as one object, and all that a person may ask of it."""

import math
import time
from collections.abc import Callable, Iterable, Iterator, Set
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from frida_painter import registry
from frida_painter.easel.kinds import GIVEN
from frida_painter.errors import ConfigError, FridaError, Interrupted
from frida_painter.objectives.objective import Gives, goal_kinds
from frida_painter.registry import are_here
from frida_painter.runs.variant_settings import VARIANTS
from frida_painter.session.events import Began
from frida_painter.session.fold import PaintingState
from frida_painter_studio import picture_choosing, studio_folder
from frida_painter_studio.form import describe_form, name_settings
from frida_painter_studio.jobs import JOBS, Imagining, JobState, Setup, TeachingRequest
from frida_painter_studio.pace import LAST, WorkTimes, find_pace
from frida_painter_studio.painting_state import PaintingPage, Status
from frida_painter_studio.picture_choosing import AllowedMakers, ChosenPicture, MakingRequest
from frida_painter_studio.security import Lead, Presence, Session
from frida_painter_studio.state import FeedStates, Shown, StateStreams, Topic
from frida_painter_studio.stop import Stops
from frida_painter_studio.stop_listener import StopProcess
from frida_painter_studio.store import Entry, PaintingStore, Uploads
from frida_painter_studio.studio_folder import PaintingFolder, PaintingRequest, PlanFolder, working
from frida_painter_studio.web_app_easel import WebAppEasel
from frida_painter_studio.workers import QUEUE, PaintingQueue, Workers, start_painting
from frida_painter_together import commands
from frida_painter_together.commands import PageCommand, Role
from frida_painter_together.inbox import FOLLOWED, KeptRequest, Reply, send

_GALLERY_EVERY = 1.0  # seconds
_AHEAD_EVERY, _MAX_AHEAD = 2.0, 100  # seconds, and newest paintings
_PATIENCE = 0.4  # seconds of reading for one answer about several paintings
_RENEWED_EVERY = 2.0  # seconds
_ROOM_TO_BEGIN, _ROOM_TO_RESUME = 200 * 2**20, 100 * 2**20  # bytes


class Studio:
    """Studio with all its parts; the routes of the web application are thin functions on it.

    store: paintings and pictures.
    easel: chosen in the terminal.
    presence: confirmations at the machine.
    stop_process: listener for stops; None for a studio that is not served on a port.
    makers: picture makers that visitors may choose; none by default.
    Its methods raise Interrupted if something cannot be done now, ConfigError if a request is wrong, StorageError,
    and RobotStopped if nobody has confirmed at the machine.
    """

    def __init__(
        self,
        store: PaintingStore,
        easel: WebAppEasel,
        presence: Presence,
        stop_process: StopProcess | None = None,
        makers: AllowedMakers | None = None,
    ) -> None:
        self.store: Final = store
        self.easel: Final = easel
        self.presence: Final = presence
        self.stop_process: Final = stop_process
        self.makers: Final = makers or AllowedMakers()
        self.lead: Final = Lead()
        self.streams: Final = StateStreams()
        self.stops: Final = Stops(store.root)
        self.uploads: Final = Uploads(store.pictures)
        self.workers: Final = Workers(easel)
        self.queue: Final = PaintingQueue(store, self.workers)
        self.feeds: Final = FeedStates(self.queue.find_job)

    # State of the studio.

    def facts(self, role: Role) -> dict[str, Any]:
        """Returns the facts about this studio for a page, with the port and the secret of its stops."""
        stop, easel = self.stop_process, self.easel
        return {
            "stop": None if stop is None else {"port": stop.port, "secret": stop.secret(role)},
            "role": role.name,
            "abilities": abilities(),
            "now": time.time(),
            "robot": easel.robot,
            "camera": bool(easel.camera) and easel.has_camera and not easel.simulated,
            "watched": easel.has_camera,
            "simulated": easel.simulated,
            "dangerous": easel.drives_machine,
            "pace": find_pace(self._last_times(), real_time=not easel.simulated),
            "canvas": easel.canvas,
            "form": describe_form(easel, self._families),
            "turns": list(registry.parts(registry.TURN_POLICIES)),
            "makers": list(self.makers.by_label),
            "variants": list(VARIANTS),
        }

    def _last_times(self) -> list[WorkTimes]:
        last = self._read_in_time(self.store.all()[:LAST])
        return [
            self.feeds.view(entry.folder, PaintingPage, lambda state, truth: state.times)
            for entry, in_time in last
            if in_time
        ]

    def _read_in_time(self, entries: Iterable[Entry]) -> Iterator[tuple[Entry, bool]]:
        """Yields each entry, and True if its state is known or can be read now, so that no page waits for long."""
        until = time.monotonic() + _PATIENCE
        for entry in entries:
            yield entry, time.monotonic() < until or self.feeds.knows(entry.folder)

    def work(self) -> dict[str, Any]:
        """Returns who is at work (ids of paintings, "calibration", "setup"), and the queue in order.

        moves: True if one of these may move the robot; a planner cannot.
        """
        entries, at_work = self.store.all(), self._at_work()
        names = {folder.path.name for folder in at_work}
        known = [entry.id for entry in entries if entry.folder.path.name in names]
        known += [name for name in JOBS if name in names]
        titles = {entry.id: entry.title for entry in entries}
        shown = self.queue.to_plain()
        waiting = [{**each, "title": titles.get(each["painting"], "")} for each in shown["queue"]]
        return {"working": known, "moves": _may_move(at_work), **shown, "queue": waiting}

    def may_move(self) -> bool:
        """Returns True if a process works that may move the robot."""
        return _may_move(self._at_work())

    def _at_work(self) -> list[PaintingFolder]:
        """Returns the folders of paintings, also deleted ones, and of the calibration, on which a process works."""
        return [folder for folder in studio_folder.find_work(self.store.root) if folder.path.name != QUEUE]

    def cards(self) -> list[dict[str, Any]]:
        """Returns the gallery's data of every painting, the newest first; "reading" for those not yet read."""
        return [self._card(entry, in_time=in_time) for entry, in_time in self._read_in_time(self.store.all())]

    def read_ahead(self) -> None:
        """Reads for ever what is painted, as it goes on, and once each other painting, so that no page waits for it."""
        while True:
            with suppress(FridaError, OSError):  # the folder is away for a moment
                for entry in self.store.all()[:_MAX_AHEAD]:
                    if not self.feeds.knows(entry.folder) or working(entry.folder):
                        self._status(entry)
            time.sleep(_AHEAD_EVERY)

    def _card(self, entry: Entry, *, in_time: bool) -> dict[str, Any]:
        status = asdict(self._status(entry)) if in_time else {"stage": "reading"}
        shown = {"id": entry.id, "title": entry.title, "begun": entry.begun, **status}
        return {**shown, "picture": _best_picture(entry.folder)}

    def _status(self, entry: Entry) -> Status:
        return self.feeds.view(entry.folder, PaintingPage, PaintingPage.status)

    def _fold(self, entry: Entry) -> PaintingState:
        return self.feeds.view(entry.folder, PaintingPage, lambda state, truth: state.painting)

    def painting(self, entry: Entry) -> dict[str, Any]:
        """Returns the state of a painting, as the page shows it."""
        shown = self.feeds.current(entry.folder, PaintingPage)
        return {"id": entry.id, "title": entry.title, "begun": entry.begun, **shown}

    def job(self, job: type[JobState]) -> dict[str, Any]:
        """Returns the state of a job, as the page shows it."""
        return self.feeds.current(self.store.job(job.name), job)

    @property
    def _families(self) -> dict[str, None]:
        """Names of the stroke families that can be painted with: registered ones, and those taught here."""
        return dict.fromkeys([*registry.parts(registry.STROKE_FAMILIES), *self.store.families])

    def topic(self, name: str) -> Topic | None:
        """Returns a state that pages follow; None for an unknown painting.

        name: id of a painting, name of a job, or "paintings" for the gallery.
        """
        fresh: Callable[[], Shown]
        if name == "paintings":
            return Topic(name, self.cards, self.cards, every=_GALLERY_EVERY)
        if name in JOBS:
            folder, fresh = self.store.job(name), JOBS[name]
        elif (entry := self.store.find(name)) is not None:
            folder, fresh = entry.folder, PaintingPage
        else:
            return None

        sign = Followed(folder.path / FOLLOWED) if name == Setup.name else None

        def mark() -> object:
            if sign is not None:
                sign.renew()
            return self.feeds.view(folder, fresh, lambda state, truth: (state.version, truth))

        return Topic(name, mark, lambda: self.feeds.current(folder, fresh))

    # Orders for plans.

    def begin(self, request: PaintingRequest, *, variants: bool = False) -> Entry:
        """Begins a painting and its first plan, or its first variants side by side."""
        wanted = self._paintable(request, variants=variants)
        entry = self.store.begin(request.title or "Untitled")
        self._plan(entry, wanted)
        return entry

    def plan_again(self, entry: Entry, request: PaintingRequest, *, variants: bool = False) -> None:
        """Makes another plan for a painting, or variants of one, from the same request or another one."""
        self._plan(entry, self._paintable(request, variants=variants))

    def _paintable(self, request: PaintingRequest, *, variants: bool) -> list[PaintingRequest]:
        """Returns the request, or one for each variant.

        Raises ConfigError, in the words of the form, if goals or settings cannot be painted at this easel.
        """
        wanted = request.variants() if variants else [request]
        self._require_pictures(request.pictures)
        self._require_ready(*request.terms, *request.initial)
        try:
            for each in wanted:
                each.spec(self.easel, self.store.pictures, self.store.root / studio_folder.FAMILIES)
        except ConfigError as error:
            raise ConfigError(name_settings(str(error))) from error
        return wanted

    def _require_ready(self, *goals: commands.GoalRequest) -> None:
        for kind in {goal.kind for goal in goals}:
            able = abilities()[kind]
            if not able["ready"]:
                raise ConfigError(str(able["advice"]))

    def _require_pictures(self, pictures: Set[str]) -> None:
        if not all((self.store.pictures / f"{name}.png").is_file() for name in pictures):
            raise ConfigError("A picture of this goal is gone; choose it again.")

    def _plan(self, entry: Entry, requests: list[PaintingRequest]) -> None:
        """Starts plans, one after the other, or puts them into the queue if other work comes first."""
        folder = entry.folder
        if folder.is_of_terminal:
            raise Interrupted("This painting was begun at the terminal, with its plan; begin a new painting here.")
        if working(folder):
            raise Interrupted("The painter is at work on this painting already.")
        if self.queue.must_wait():
            self.queue.add(entry, lambda: self._request_plans(entry, requests), "plan")
            return
        with self.workers.slot_at(folder) as slot:
            folder.stop.unlink(missing_ok=True)
            slot.start("plan", self._request_plans(entry, requests))

    def _request_plans(self, entry: Entry, requests: list[PaintingRequest]) -> PlanFolder:
        """Makes the folders of new plans, reports them to the page, and returns the first one."""
        plans = entry.folder.begin_plans(requests, self.store.pictures)
        for place, (plan, request) in enumerate(zip(plans, requests, strict=True)):
            wish = request.model_dump(mode="json")
            studio_folder.tell_once(entry.folder, Began("plan", "beside" * (place > 0), plan.number, wish))
        if (title := requests[0].title) and title != entry.title:
            self.store.rename(entry.id, title)
        return plans[0]

    # Orders for paintings.

    def start(self, entry: Entry, number: int, by: Session, *, ready: bool, wait: bool) -> None:
        """Starts to paint a plan, or puts it into the queue.

        ready: True if the person confirms canvas and paints.
        wait: True to put it into the queue.
        """
        if not ready and not wait:
            raise ConfigError("Say first that the canvas and the paints are ready.")
        folder = entry.folder
        plan = folder.plan(number)
        if not plan.plan.is_file():
            raise ConfigError("This plan is not finished; wait for it, or choose another one.")
        if folder.painting.exists():
            raise Interrupted("This painting has been begun already; to paint it once more, take Paint again.")
        studio_folder.require_disk(folder.path, _ROOM_TO_BEGIN)
        if wait:
            self.queue.add(entry, lambda: plan, "paint")
            self.store.note(by.id, entry.id, f"queue plan {number}")
            return
        with self.workers.slot_at(folder) as slot:
            self.presence.allow(self.easel)
            folder.stop.unlink(missing_ok=True)
            self.store.note(by.id, entry.id, f"start plan {number}")
            self.queue.remove(entry.id)
            start_painting(slot, plan)

    def resume(self, entry: Entry, by: Session) -> None:
        """Resumes a painting that was stopped, killed or failed, also one that was begun at the terminal."""
        folder, status = entry.folder, self._status(entry)
        if status.stage == "finished":
            raise Interrupted("This painting is finished; to paint it once more, take Paint again.")
        if status.working:
            raise Interrupted("The painter is at work on this painting already.")
        if not status.resumable:
            raise Interrupted("There is nothing to go on with: no stroke was painted yet.")
        plan, sittings = self.feeds.view(folder, PaintingPage, lambda page, truth: (page.plan, page.painting.sittings))
        robot = sittings.settings.get("robot")
        if robot != self.easel.robot:
            raise ConfigError(
                f"This painting is painted by {robot!r}, and this studio is open for {self.easel.robot!r}; open it "
                f"with --robot {robot}, or type: frida-painter resume {folder.painting.relative_to(self.store.root)}"
            )
        studio_folder.require_disk(folder.path, _ROOM_TO_RESUME)
        with self.workers.slot_at(folder) as slot:
            self.presence.allow(self.easel)
            folder.stop.unlink(missing_ok=True)
            folder.robot_stop.unlink(missing_ok=True)
            self.store.note(by.id, entry.id, "resume")
            studio_folder.tell_once(folder, Began("resume", plan=plan, detail={"sittings": sittings.count}))
            slot.start("resume", folder.plan(plan))

    def say(self, entry: Entry, command: PageCommand, by: Session) -> None:
        """Sends a command to the painter of a running painting."""
        if not (entry.folder.painting.is_dir() and working(entry.folder)):
            raise Interrupted("Nothing is being painted here at the moment.")
        pictures: Set[str] = frozenset()
        match command:
            case commands.Protect(picture) | commands.GivePicture(picture):
                pictures = {picture}
            case commands.ChangeGoal(terms, initial):
                self._require_ready(*terms, *initial)
                pictures = commands.pictures_of(*terms, *initial)
            case commands.Propose(words, maker):
                if self._fold(entry).wishes.request.get("kind") == "propose":
                    raise Interrupted("Pictures are being made here already; wait until they are there, or stop it.")
                self.makers.order(words, maker).keep(entry.folder.painting)
            case commands.TakeTurns(policy=policy) if policy not in registry.parts(registry.TURN_POLICIES):
                known = ", ".join(registry.parts(registry.TURN_POLICIES))
                raise ConfigError(f"There is no way of taking turns {policy!r}; take one of {known}.")
            case commands.PaintStroke():
                painting = self._fold(entry)
                if not painting.wishes.paused:
                    raise Interrupted(commands.ROBOT_MOVES)
                if painting.people.may_paint is None and not painting.people.strokes:
                    raise Interrupted("Nobody can paint through the page here; paint on the canvas with a real brush.")
        self._require_pictures(pictures)
        studio_folder.copy_pictures(pictures, self.store.pictures, entry.folder.painting / GIVEN)
        self.store.note(by.id, entry.id, commands.describe(command))
        send(entry.folder.painting, command)

    def answer(self, of: Entry | type[JobState], given: Reply, by: Session) -> None:
        """Answers a question of a painter or a job, moves brush or tip as asked, or leaves the setup."""
        name, folder = (of.id, of.folder) if isinstance(of, Entry) else (of.name, self.store.job(of.name))
        asked, place = (self.painting(of), folder.painting) if isinstance(of, Entry) else (self.job(of), folder.path)
        self.store.note(by.id, name, f"answer: {given.words}")
        _hand_on(given, folder, asked["question"], place)

    def delete(self, entry: Entry, by: Session) -> None:
        """Deletes a painting with all its files, while no worker can begin there."""
        lock = studio_folder.WorkerLock(entry.folder)
        try:
            if not lock.take():
                raise Interrupted("The painter is at work on this painting; stop it first.")
            self.queue.remove(entry.id)
            self.store.note(by.id, entry.id, "delete")
            self.store.delete(entry)
        finally:
            lock.release()

    # Orders for jobs beside paintings.

    def begin_job(self, job: type[JobState], request: KeptRequest | MakingRequest, by: Session) -> None:
        """Starts a job; no request names a program. A setup moves a real machine, at every easel."""
        order = self._complete(request)
        folder = self.store.job(job.name)
        studio_folder.require_disk(folder.path, _ROOM_TO_BEGIN)
        with self.workers.slot_at(folder) as slot:
            if job.moves == "always":
                self.presence.require()
            elif job.moves == "easel":
                self.presence.allow(self.easel)
            folder.stop.unlink(missing_ok=True)
            started = job.begin(order)
            self.store.note(by.id, job.name, f"start {started.detail}")
            order.keep(folder.path)
            studio_folder.tell_once(folder, started)
            slot.start(job.name, folder.plan(1))

    def _complete(self, request: KeptRequest | MakingRequest) -> KeptRequest:
        """Returns the request for the worker. Raises ConfigError for a taken name or a maker that is not allowed."""
        if isinstance(request, MakingRequest):
            more = request.model_dump(exclude={"words", "maker"})
            return self.makers.order(request.words, request.maker, **more)
        if isinstance(request, TeachingRequest) and request.name in self._families:  # paintings with it may go on
            raise ConfigError(f"There is a stroke family {request.name!r} already; give yours another name.")
        return request

    def stop_imagining(self, by: Session) -> None:
        """Stops the making of pictures, and no other work."""
        folder = self.store.job(Imagining.name)
        if working(folder):
            self.store.note(by.id, Imagining.name, "stop")
            folder.stop_now()

    def choose_picture(self, chosen: ChosenPicture, by: Session, entry: Entry | None = None) -> dict[str, str]:
        """Takes a made picture, or a proposed one of a painting, among the pictures for goals.

        Returns its id, and how it was made.
        """
        if entry is None:
            folder = self.store.job(Imagining.name)
            makings = self.feeds.view(folder, Imagining, lambda state, truth: list(state.makings))
            root = folder.path / picture_choosing.MADE
        else:
            proposed = self._fold(entry).wishes.proposed
            makings, root = [proposed] if proposed else [], entry.folder.painting
        made = picture_choosing.take_picture(chosen, makings, root, self.store.pictures)
        self.store.note(by.id, Imagining.name if entry is None else entry.id, f"choose {made['made']}")
        return made


@dataclass
class Followed:
    """Sign for a worker in another process that a page follows it: a file whose time changes."""

    path: Path
    _renewed: float = -math.inf

    def renew(self) -> None:
        """Renews the sign if the last time was some seconds ago; a disk that fails costs only the sign."""
        now = time.monotonic()
        if now >= self._renewed + _RENEWED_EVERY:
            self._renewed = now
            with suppress(OSError):
                self.path.touch()


def _may_move(at_work: list[PaintingFolder]) -> bool:
    still = {studio_folder.PLAN_JOB, *(name for name, job in JOBS.items() if job.moves == "never")}
    return any(studio_folder.find_job(folder) not in still for folder in at_work)


def _hand_on(given: Reply, folder: PaintingFolder, asked: Any, place: Path) -> None:
    """Hands an answer to the asking process, by the inbox in `place`. Raises Interrupted if none asks, ConfigError."""
    if not isinstance(asked, dict) or asked.get("id") != given.question or not working(folder):
        raise Interrupted("This is not asked any more; look at the page.")
    if not (given.leave and asked.get("leave") is True):
        given.answering(str(asked["kind"]), asked)
    send(place, given)


def _best_picture(folder: PaintingFolder) -> str | None:
    """Returns the picture of the painting, or else of its newest plan; None if there is none."""
    shown = ("painting/canvas.png", "painting/painting.png")  # the latter may be a large print
    candidates = [*shown, *(f"{plan.number}/plan.jpg" for plan in reversed(folder.plans()))]
    for candidate in candidates:
        place, _, name = candidate.partition("/")
        if folder.find_shown(place, name) is not None:
            return candidate
    return None


# Abilities of this studio: the kinds of goals, and the missing parts of each.

# Extra that a kind of goal needs besides its networks, and a package of that extra.
_EXTRAS = {"text": ("words", "transformers")}


def abilities() -> dict[str, dict[str, object]]:
    """Returns for each kind of goal: True if it is ready, missing weights, names to fetch, and a sentence of advice.

    Its label, what it does, and True if it is given as words, for the page, which knows no kind of another package.
    """
    found: dict[str, dict[str, object]] = {}
    for name, kind in goal_kinds().by_name.items():
        missing = [group[-1] for group in kind.networks if not any(map(are_here, group))]
        fetch, said = ["words"] if name == "text" and missing else missing, []
        if name in _EXTRAS and not registry.is_installed(_EXTRAS[name][1]):
            said.append(registry.advice(_EXTRAS[name][0], "This"))
        if missing:
            command = f"frida-painter models fetch {' '.join(fetch)}"
            said.append(f"This needs a network that is not here yet; fetch it with: {command}")
        about = {"label": kind.label, "verb": kind.help.removesuffix("."), "words": kind.gives is Gives.WORDS}
        found[name] = {"ready": not said, "missing": missing, "fetch": fetch, "advice": ". ".join(said), **about}
    return found
