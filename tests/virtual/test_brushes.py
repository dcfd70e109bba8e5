import pytest

from frida_painter.errors import ConfigError
from frida_painter.virtual.bristles import brush_names, find_brush


def test_brushes_grow_from_fine_to_broad_and_open_when_pressed():
    brushes = [find_brush(name) for name in brush_names()]
    assert brush_names() == ("fine", "medium", "broad")
    assert [b.radius(0.8) for b in brushes] == sorted(b.radius(0.8) for b in brushes)
    assert all(b.radius(0.05) < b.radius(0.5) < b.radius(1) for b in brushes)


def test_an_unknown_brush_is_refused_by_naming_the_known_ones():
    with pytest.raises(ConfigError, match=r"'mop'.*fine, medium, broad"):
        find_brush("mop")
