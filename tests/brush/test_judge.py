from dataclasses import replace

import numpy as np
import pytest

from frida_painter.brush.library import Flaw, clean, judge, judge_marks
from frida_painter.errors import LibraryError
from marks import small_library

COUNT = 40


def spoiled(index, mark):
    """A library of good strokes with another mark at one place."""
    library = small_library(COUNT)
    magnitude = library.magnitude.copy()
    magnitude[index] = mark(magnitude[index].copy())
    return replace(library, magnitude=magnitude)


def longest(library):
    return int(np.argmax(library.length_m * (library.thickness > 0.6)))


def test_good_strokes_are_left_alone():
    assert not judge_marks(small_library(COUNT)).any()


def with_holes(mark):
    """The inside of the mark bare, as where an earlier mark lay."""
    inked = mark > 80
    inside = np.zeros_like(inked)
    for column in np.flatnonzero(inked.any(0)):
        rows = np.flatnonzero(inked[:, column])
        inside[rows[0] + 5 : rows[-1] - 4, column] = True
    return np.where(inside, 0, mark)


def dry(mark):
    """Paint on the tops of the weave only."""
    rows, columns = np.indices(mark.shape)
    return np.where((rows // 2 + columns // 2) % 2 == 0, mark, 0)


def with_a_neighbour(mark):
    mark[:6, 60:110] = 250
    return mark


def broken_off(mark):
    columns = np.flatnonzero(mark.any(0))
    mark[:, columns[len(columns) // 2] :] = 0
    return mark


@pytest.mark.parametrize(
    ("spoil", "flaw"),
    [
        (lambda mark: np.zeros_like(mark), Flaw.EMPTY),
        (lambda mark: mark // 5, Flaw.EMPTY),
        (with_holes, Flaw.TORN),
        (dry, Flaw.TORN),
        (with_a_neighbour, Flaw.TOUCHED),
        (broken_off, Flaw.SKIPPED),
        (lambda mark: np.roll(mark, 12, 0), Flaw.ASTRAY),
    ],
)
def test_a_dirty_stroke_is_found_with_its_reason_and_no_other_is_blamed(spoil, flaw):
    index = longest(small_library(COUNT))
    flaws = judge_marks(spoiled(index, spoil))
    assert Flaw(flaws[index]) is flaw
    assert np.flatnonzero(flaws).tolist() == [index]


def test_a_third_of_empty_strokes_does_not_make_the_others_look_wrong():
    library = small_library(COUNT)
    empty = np.arange(COUNT) % 3 == 0
    magnitude = np.where(empty[:, None, None], library.magnitude // 6, library.magnitude)
    flaws = judge_marks(replace(library, magnitude=magnitude))
    np.testing.assert_array_equal(flaws == Flaw.EMPTY, empty)


def test_what_was_judged_when_it_was_painted_stays_so():
    flaws = np.zeros(COUNT, np.uint8)
    flaws[3] = Flaw.MOVED
    library = replace(small_library(COUNT), flaws=flaws)
    assert judge(library) is flaws
    assert len(clean(library)) == COUNT - 1
    assert 3 not in clean(library).recorded_index


def test_a_library_of_flaws_alone_has_nothing_to_learn_from():
    library = small_library(5)
    with pytest.raises(LibraryError):
        clean(replace(library, magnitude=0 * library.magnitude))
