import torch

from frida_painter.report.sheets import Cell, FigureRow, page

RED = torch.tensor([0.8, 0.1, 0.1])[:, None, None]


def reds(sheet: torch.Tensor) -> torch.Tensor:
    return (sheet - RED).abs().amax(0) < 0.02


def test_every_picture_is_there_at_the_width_that_was_asked_for():
    picture = RED.expand(3, 30, 40)
    sheet = page(
        "Title",
        ("one", "two"),
        [FigureRow("row", [Cell(picture, "below"), None]), FigureRow("", [None, Cell(picture)])],
        width=80,
        framed=False,
    )
    found = reds(sheet)
    assert int(found.sum()) == 2 * 80 * 60
    rows, columns = torch.nonzero(found, as_tuple=True)
    assert int(rows.max()) < sheet.shape[1] - 8 and int(columns.max()) < sheet.shape[2] - 8


def test_words_take_room_and_do_not_cover_pictures():
    picture = RED.expand(3, 40, 40)
    plain = page("", (), [FigureRow("", [Cell(picture)])], width=40, framed=False)
    told = page("Title", ("above",), [FigureRow("a longer label", [Cell(picture, "below")])], width=40, framed=False)
    assert told.shape[1] > plain.shape[1] and told.shape[2] > plain.shape[2]
    assert int(reds(told).sum()) == int(reds(plain).sum()) == 1600
