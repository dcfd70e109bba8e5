"""Inner loops of the renderer for a GPU: one program paints one tile of the canvas, stroke after stroke.

Triton compiles them; it comes with PyTorch for CUDA. All tensors are contiguous and have one precision. The
channels of a picture [3, H, W] lie H * W apart. numbers [2] are those of `CoverageSpread`. The recurrences are
those of `blend_moments` in kernels.py; docs/explanation/renderer.md derives them.

Sums over several tiles are added as integers, because their result does not depend on the order.
"""

import triton
import triton.language as tl


@triton.jit
def _touches(boxes, stroke, top, left, ROWS: tl.constexpr, COLUMNS: tl.constexpr):
    """Returns True if the stroke's box of pixels [top, bottom) x [left, right) meets the tile."""
    box = boxes + 4 * stroke
    below = (tl.load(box) < top + ROWS) & (tl.load(box + 1) > top)
    return below & (tl.load(box + 2) < left + COLUMNS) & (tl.load(box + 3) > left)


@triton.jit
def _strokes_of(top, left, counts, lists, strokes, bin_side, bins_across):
    """Returns the list of the strokes whose boxes meet the bin of a tile, in painting order, and their number."""
    place = (top // bin_side) * bins_across + left // bin_side
    return lists + place * strokes, tl.load(counts + place)


@triton.jit
def _cells(maps, affine, stroke, x, y, inside, rows, columns):
    """Returns the place of pixels on the stroke's map.

    Returns cell offset, right and lower share, values of four cells, four flags. Cells outside the map are
    zero. The flags tell which of the four cells are inside.
    """
    place = affine + 6 * stroke
    column = tl.load(place) * x + tl.load(place + 1) * y + tl.load(place + 2)
    row = tl.load(place + 3) * x + tl.load(place + 4) * y + tl.load(place + 5)
    column = tl.minimum(tl.maximum(column, -2), columns + 1)  # farther cells are bare as well
    row = tl.minimum(tl.maximum(row, -2), rows + 1)
    left, above = tl.floor(column), tl.floor(row)
    right_share, below_share = column - left, row - above
    at_column, at_row = left.to(tl.int32), above.to(tl.int32)
    here, beside = (at_column >= 0) & (at_column < columns), (at_column >= -1) & (at_column < columns - 1)
    level, under = (at_row >= 0) & (at_row < rows), (at_row >= -1) & (at_row < rows - 1)
    on_0, on_1 = inside & level & here, inside & level & beside
    on_2, on_3 = inside & under & here, inside & under & beside
    offset = tl.full((), 1, tl.int64) * rows * columns * stroke + at_row * columns + at_column
    value_0, value_1 = tl.load(maps + offset, on_0, 0), tl.load(maps + offset + 1, on_1, 0)
    value_2 = tl.load(maps + offset + columns, on_2, 0)
    value_3 = tl.load(maps + offset + columns + 1, on_3, 0)
    return offset, right_share, below_share, value_0, value_1, value_2, value_3, on_0, on_1, on_2, on_3


@triton.jit
def _cover(right_share, below_share, value_0, value_1, value_2, value_3):
    """Returns the bilinear value of the map."""
    upper = value_0 * (1 - right_share) + value_1 * right_share
    lower = value_2 * (1 - right_share) + value_3 * right_share
    return upper * (1 - below_share) + lower * below_share


@triton.jit
def _away(red, green, blue, paint):
    """Returns the differences of means from the paint in three channels, and the mean of their squares."""
    red, green, blue = red - tl.load(paint), green - tl.load(paint + 1), blue - tl.load(paint + 2)
    return red, green, blue, (red * red + green * green + blue * blue) / 3


@triton.jit
def _lay(red, green, blue, variance, paint, cover, share, full):
    """Returns the moments after a stroke of mean coverage `cover`."""
    from_red, from_green, from_blue, apart = _away(red, green, blue, paint)
    keeps = 1 - cover
    doubt = share * cover * tl.maximum(full - cover, 0)
    variance = (keeps * keeps + doubt) * variance + doubt * apart
    return red - cover * from_red, green - cover * from_green, blue - cover * from_blue, variance


@triton.jit
def _store(planes, at, plane, inside, red, green, blue, variance):
    """Writes the means of three channels and the variance as four planes."""
    tl.store(planes + at, red, inside)
    tl.store(planes + at + plane, green, inside)
    tl.store(planes + at + 2 * plane, blue, inside)
    tl.store(planes + at + 3 * plane, variance, inside)


@triton.jit
def _load(planes, at, plane, inside):
    """Reads the four planes of `_store`."""
    return (
        tl.load(planes + at, inside, 0),
        tl.load(planes + at + plane, inside, 0),
        tl.load(planes + at + 2 * plane, inside, 0),
        tl.load(planes + at + 3 * plane, inside, 0),
    )


@triton.jit
def lay(
    maps, affine, color, boxes, counts, lists, numbers, canvas, moments, kept,
    strokes, bin_side, bins_across, height, width, rows, columns, segment,
    KEEP: tl.constexpr, ROWS: tl.constexpr, COLUMNS: tl.constexpr,
):  # fmt: skip
    """Computes mean and variance [4, H, W] after all strokes from those of the canvas [4, H, W].

    counts [bins], lists [bins, n]: strokes that meet each bin of the canvas (`tiles._bins`)
    KEEP: True to write the moments below each stroke whose number in its list is divisible by `segment` to kept
    [segments, 4, H, W]
    """
    top, left = tl.program_id(1) * ROWS, tl.program_id(0) * COLUMNS
    y, x = top + tl.arange(0, ROWS)[:, None], left + tl.arange(0, COLUMNS)[None, :]
    inside = (y < height) & (x < width)
    plane = height * width
    leap = tl.full((), 4, tl.int64) * plane  # offset from the moments of one picture to the next
    at = y * width + x
    share, full = tl.load(numbers), tl.load(numbers + 1)
    red, green, blue, variance = _load(canvas, at, plane, inside)
    mine, found = _strokes_of(top, left, counts, lists, strokes, bin_side, bins_across)
    for index in range(found):
        if KEEP:  # noqa: SIM102 - nested, so that Triton can leave it out
            if index % segment == 0:
                begun = kept + (index // segment) * leap
                _store(begun, at, plane, inside, red, green, blue, variance)
        stroke = tl.load(mine + index)
        if _touches(boxes, stroke, top, left, ROWS, COLUMNS):
            _, right, below, v_0, v_1, v_2, v_3, _, _, _, _ = _cells(maps, affine, stroke, x, y, inside, rows, columns)
            cover = _cover(right, below, v_0, v_1, v_2, v_3)
            paint = color + 3 * stroke
            red, green, blue, variance = _lay(red, green, blue, variance, paint, cover, share, full)
    _store(moments, at, plane, inside, red, green, blue, variance)


@triton.jit
def _pull_back(red, green, blue, variance, paint, cover, share, full, to_red, to_green, to_blue, to_variance):
    """Returns gradients of one stroke: of its coverage, of its paint (three), and of the four moments below it."""
    from_red, from_green, from_blue, apart = _away(red, green, blue, paint)
    keeps, bare = 1 - cover, tl.maximum(full - cover, 0)
    doubt = share * cover * bare
    rising = tl.where(bare > 0, share * (bare - cover), 0)
    to_cover = to_variance * (rising * (variance + apart) - 2 * keeps * variance)
    to_cover -= to_red * from_red + to_green * from_green + to_blue * from_blue
    crossed = 2 * doubt * to_variance / 3
    return (
        to_cover,
        cover * to_red - crossed * from_red,
        cover * to_green - crossed * from_green,
        cover * to_blue - crossed * from_blue,
        keeps * to_red + crossed * from_red,
        keeps * to_green + crossed * from_green,
        keeps * to_blue + crossed * from_blue,
        (keeps * keeps + doubt) * to_variance,
    )


@triton.jit
def _whole(values):
    """Converts to integers; NaN becomes 0."""
    return tl.where(values == values, values, 0).to(tl.int64)


@triton.jit
def _add(sums, index, values, scale):
    """Adds the sum of the values to an integer sum."""
    tl.atomic_add(sums + index, _whole(tl.sum(tl.sum(values, 1), 0) * scale), sem="relaxed")


@triton.jit
def pull(
    maps, affine, color, boxes, counts, lists, numbers, kept, states, gradients, scale, to_maps, to_strokes, to_canvas,
    strokes, bin_side, bins_across, height, width, rows, columns, segment, segments,
    BARE_ANSWERS: tl.constexpr, ROWS: tl.constexpr, COLUMNS: tl.constexpr,
):  # fmt: skip
    """Computes the gradients of all inputs of `lay` from gradients [4, H, W] of the moments.

    counts, lists, kept: as in `lay`
    states [segment, 4, H, W]: memory for the moments below the strokes of one segment
    scale [1]: factor from gradients to integers
    to_maps [n, rows, columns]: int64, zeros at first
    to_strokes [n, 9]: int64, zeros at first; six numbers of the affine map, three of the colour
    to_canvas [4, H, W]: gradient of the canvas
    BARE_ANSWERS: True to compute gradients of cells without paint around them
    """
    top, left = tl.program_id(1) * ROWS, tl.program_id(0) * COLUMNS
    y, x = top + tl.arange(0, ROWS)[:, None], left + tl.arange(0, COLUMNS)[None, :]
    inside = (y < height) & (x < width)
    plane = height * width
    leap = tl.full((), 4, tl.int64) * plane  # offset from the moments of one picture to the next
    at = y * width + x
    share, full, unit = tl.load(numbers), tl.load(numbers + 1), tl.load(scale)
    to_red, to_green, to_blue, to_variance = _load(gradients, at, plane, inside)
    mine, found = _strokes_of(top, left, counts, lists, strokes, bin_side, bins_across)
    for back in range(segments):
        number = segments - 1 - back
        first = number * segment
        count = tl.minimum(segment, found - first)  # not above 0 if the list ends before
        red, green, blue, variance = _load(kept + number * leap, at, plane, inside)
        for index in range(count):  # computes the moments below each stroke again
            stroke = tl.load(mine + first + index)
            if _touches(boxes, stroke, top, left, ROWS, COLUMNS):
                state = states + index * leap
                _store(state, at, plane, inside, red, green, blue, variance)
                _, right, below, v_0, v_1, v_2, v_3, _, _, _, _ = _cells(
                    maps, affine, stroke, x, y, inside, rows, columns
                )
                cover = _cover(right, below, v_0, v_1, v_2, v_3)
                paint = color + 3 * stroke
                red, green, blue, variance = _lay(red, green, blue, variance, paint, cover, share, full)
        tl.debug_barrier()  # threads of the program read what other threads wrote
        for index in range(count):
            stroke = tl.load(mine + first + count - 1 - index)
            if _touches(boxes, stroke, top, left, ROWS, COLUMNS):
                state = states + (count - 1 - index) * leap
                red, green, blue, variance = _load(state, at, plane, inside)
                cell, right, below, v_0, v_1, v_2, v_3, on_0, on_1, on_2, on_3 = _cells(
                    maps, affine, stroke, x, y, inside, rows, columns
                )
                cover = _cover(right, below, v_0, v_1, v_2, v_3)
                paint, sums = color + 3 * stroke, to_strokes + 9 * stroke
                slope, of_red, of_green, of_blue, to_red, to_green, to_blue, to_variance = _pull_back(
                    red, green, blue, variance, paint, cover, share, full, to_red, to_green, to_blue, to_variance
                )
                slope = tl.where(inside, slope, 0)
                _add(sums, 6, of_red, unit)
                _add(sums, 7, of_green, unit)
                _add(sums, 8, of_blue, unit)
                by_column = slope * ((v_1 - v_0) * (1 - below) + (v_3 - v_2) * below)
                by_row = slope * ((v_2 - v_0) * (1 - right) + (v_3 - v_1) * right)
                _add(sums, 0, by_column * x, unit)
                _add(sums, 1, by_column * y, unit)
                _add(sums, 2, by_column, unit)
                _add(sums, 3, by_row * x, unit)
                _add(sums, 4, by_row * y, unit)
                _add(sums, 5, by_row, unit)
                if not BARE_ANSWERS:
                    painted = (v_0 != 0) | (v_1 != 0) | (v_2 != 0) | (v_3 != 0)
                    on_0, on_1, on_2, on_3 = on_0 & painted, on_1 & painted, on_2 & painted, on_3 & painted
                upper, lower = slope * (1 - below) * unit, slope * below * unit
                corner = to_maps + cell
                tl.atomic_add(corner, _whole(upper * (1 - right)), on_0, sem="relaxed")
                tl.atomic_add(corner + 1, _whole(upper * right), on_1, sem="relaxed")
                tl.atomic_add(corner + columns, _whole(lower * (1 - right)), on_2, sem="relaxed")
                tl.atomic_add(corner + columns + 1, _whole(lower * right), on_3, sem="relaxed")
        tl.debug_barrier()  # before the next segment overwrites the moments
    _store(to_canvas, at, plane, inside, to_red, to_green, to_blue, to_variance)
