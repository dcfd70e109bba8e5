"""A stroke library: photographs of single strokes that the robot painted, cut out as magnitude maps."""

import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from frida_painter import storage
from frida_painter.brush.flaw import Flaw
from frida_painter.brush.resample import resample
from frida_painter.errors import LibraryError
from frida_painter.frames import MapFrame

MOST_STROKES = 20_000
MOST_BYTES = 2**31
_KEYS = ("magnitude", "length_m", "bend_m", "thickness", "metres_per_pixel", "origin_px", "recorded_index")
_OPTIONAL_KEYS = ("flaws", "since_dip")
_DAMAGED = (
    OSError,
    EOFError,
    ValueError,
    TypeError,
    KeyError,
    SyntaxError,
    RuntimeError,
    MemoryError,
    OverflowError,
    zipfile.BadZipFile,
    zlib.error,
)


@dataclass(frozen=True)
class StrokeLibrary:
    """n strokes and the marks that they left.

    magnitude [n, rows, columns] uint8: 255 full paint, 0 bare canvas, rectified to the canvas plane;
    length_m, bend_m [n] metres and thickness [n] in [0, 1]: what the robot was asked to paint, bends
    above 0 towards smaller rows; metres_per_pixel: scale of both axes; origin_px: (row, column) of
    the crop where each stroke was asked to start, heading towards larger columns;
    recorded_index [n]: order of recording; flaws [n] of `Flaw`: what is wrong with each stroke, None
    where nobody has judged them; since_dip [n]: square metres that the brush had painted since it was
    dipped, 0 for a full one, None where that is not known. Raises LibraryError where the parts cannot be true.
    """

    magnitude: NDArray[np.uint8]
    length_m: NDArray[np.float32]
    bend_m: NDArray[np.float32]
    thickness: NDArray[np.float32]
    metres_per_pixel: float
    origin_px: tuple[float, float]
    recorded_index: NDArray[np.int32]
    flaws: NDArray[np.uint8] | None = None
    since_dip: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.magnitude.ndim != 3 or self.magnitude.dtype != np.uint8 or 0 in self.magnitude.shape:
            raise LibraryError(
                f"A stroke library has magnitude maps of shape {self.magnitude.shape} and kind {self.magnitude.dtype}; "
                "they are strokes x rows x columns of whole numbers from 0 to 255, and at least one."
            )
        n = len(self.magnitude)
        if n > MOST_STROKES:
            raise LibraryError(f"A stroke library has {n} strokes; it has at most {MOST_STROKES}.")
        if self.recorded_index.shape != (n,):
            raise LibraryError(f"A stroke library has {len(self.recorded_index)} recorded_index for {n} strokes.")
        if self.flaws is not None and (self.flaws.shape != (n,) or not (self.flaws <= max(Flaw)).all()):
            raise LibraryError(
                f"A stroke library has flaws that are not {n} numbers from 0 to {max(Flaw):d}; "
                "give a library that this version of `frida-painter strokes paint` wrote."
            )
        if self.since_dip is not None and not (
            self.since_dip.shape == (n,) and ((self.since_dip >= 0) & (self.since_dip <= 1)).all()
        ):
            raise LibraryError(
                f"A stroke library has since_dip that are not {n} areas from 0 to 1 m2; "
                "give a library that `frida-painter strokes paint` wrote."
            )
        ranges = {"length_m": (0.0, 1.0), "bend_m": (-1.0, 1.0), "thickness": (0.0, 1.0)}
        for name, (least, most) in ranges.items():
            values = getattr(self, name)
            if values.shape != (n,) or not ((values >= least) & (values <= most)).all():
                raise LibraryError(
                    f"A stroke library has {name} that are not {n} numbers from {least:g} to {most:g}; "
                    "give a library that `frida-painter strokes paint` wrote."
                )
        if not 1e-6 <= self.metres_per_pixel <= 0.1:
            raise LibraryError(
                f"A stroke library has {self.metres_per_pixel} metres per pixel; allowed is 1e-6 to 0.1."
            )
        if len(self.origin_px) != 2 or not all(-1e5 <= place <= 1e5 for place in self.origin_px):
            raise LibraryError(f"A stroke library has its strokes start at {self.origin_px}; give (row, column).")

    def __len__(self) -> int:
        return len(self.magnitude)

    def __getitem__(self, index: NDArray[np.int64] | NDArray[np.bool_] | slice) -> "StrokeLibrary":
        """Some of the strokes."""
        return StrokeLibrary(
            self.magnitude[index],
            self.length_m[index],
            self.bend_m[index],
            self.thickness[index],
            self.metres_per_pixel,
            self.origin_px,
            self.recorded_index[index],
            None if self.flaws is None else self.flaws[index],
            None if self.since_dip is None else self.since_dip[index],
        )

    @property
    def frame(self) -> MapFrame:
        """The rectangle that the crops cover, with the cells that they have."""
        _, rows, columns = self.magnitude.shape
        row, column = self.origin_px
        pitch = self.metres_per_pixel
        left, top = -(column + 0.5) * pitch, (row + 0.5) * pitch
        return MapFrame(left, left + columns * pitch, top - rows * pitch, top, rows, columns)

    def maps(self, frame: MapFrame) -> Tensor:
        """The marks on the cells of a stroke model's frame, [n, rows, columns] in [0, 1]; bare beyond the crops."""
        return torch.cat([resample(torch.from_numpy(part).float() / 255, self.frame, frame) for part in self._parts()])

    def shapes(self) -> tuple[Tensor, Tensor, Tensor]:
        """Thickness, length and bend [n] of the strokes, float32, as a stroke model takes them."""
        return tuple(torch.from_numpy(np.asarray(part)) for part in (self.thickness, self.length_m, self.bend_m))  # type: ignore[return-value]

    def _parts(self) -> list[NDArray[np.uint8]]:
        return np.array_split(self.magnitude, -(-len(self) // 32))

    def save(self, path: Path) -> None:
        """Writes an .npz, atomically. Raises StorageError."""
        known = {"flaws": self.flaws, "since_dip": self.since_dip}
        optional: dict[str, Any] = {name: part for name, part in known.items() if part is not None}
        with storage.replacing(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(
                file,
                magnitude=self.magnitude,
                length_m=self.length_m,
                bend_m=self.bend_m,
                thickness=self.thickness,
                metres_per_pixel=np.float64(self.metres_per_pixel),
                origin_px=np.array(self.origin_px, np.float32),
                recorded_index=self.recorded_index,
                **optional,
            )

    @classmethod
    def load(cls, path: Path) -> "StrokeLibrary":
        """Reads an .npz and checks all of it; a pickle inside is never run. Raises LibraryError."""
        arrays = _read(path)
        kinds = {name: array.dtype.kind for name, array in arrays.items()}
        whole = {kinds.get(name, "u") for name in ("recorded_index", "flaws")}
        if not set(kinds.values()) <= set("fiu") or not whole <= set("iu"):
            raise LibraryError(f"{path} is not a stroke library: it holds something else than numbers.")
        if arrays["metres_per_pixel"].size != 1 or arrays["origin_px"].size != 2:
            raise LibraryError(f"{path} is not a stroke library: metres_per_pixel is 1 number and origin_px are 2.")
        row, column = (float(place) for place in arrays["origin_px"].ravel())
        if arrays["magnitude"].dtype != np.uint8:
            raise LibraryError(f"{path} is not a stroke library: its magnitude is not of kind uint8.")
        try:
            return cls(
                magnitude=arrays["magnitude"].astype(np.uint8),
                length_m=arrays["length_m"].astype(np.float32),
                bend_m=arrays["bend_m"].astype(np.float32),
                thickness=arrays["thickness"].astype(np.float32),
                metres_per_pixel=float(arrays["metres_per_pixel"].ravel()[0]),
                origin_px=(row, column),
                recorded_index=arrays["recorded_index"].astype(np.int32),
                flaws=arrays["flaws"].astype(np.uint8) if "flaws" in arrays else None,
                since_dip=arrays["since_dip"].astype(np.float32) if "since_dip" in arrays else None,
            )
        except LibraryError as cause:
            raise LibraryError(f"{path}: {cause}") from cause


def _read(path: Path) -> dict[str, NDArray[np.generic]]:
    """The arrays of a library's file by name. Raises LibraryError."""
    try:
        with storage.opened(path, "a stroke library (.npz)", MOST_BYTES, LibraryError) as file:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > MOST_BYTES:
                raise LibraryError(f"{path} unpacks to {unpacked} bytes; a stroke library has at most {MOST_BYTES}.")
            file.seek(0)
            with np.load(file, allow_pickle=False) as stored:
                missing = [name for name in _KEYS if name not in stored]
                if missing:
                    raise LibraryError(f"{path} is not a stroke library: it has no {', '.join(missing)}.")
                return {name: stored[name] for name in (*_KEYS, *_OPTIONAL_KEYS) if name in stored}
    except _DAMAGED as cause:
        raise LibraryError(
            f"{path} is not a stroke library: it is cut off, damaged or of another kind ({cause}); "
            "give an undamaged .npz that `frida-painter strokes paint` wrote."
        ) from cause
