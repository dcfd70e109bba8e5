"""What a prompt says of its setting."""

from frida_painter.words.setting import is_idea
from support.networks import WordBag


def test_a_feeling_is_an_idea_and_a_thing_is_none() -> None:
    bag = WordBag()
    assert is_idea("grief", ["grief"], bag, is_pictured=False), "it has no other sense"
    assert is_idea("grief", [], bag, is_pictured=True) and not is_idea("grief", ["grief"], bag, is_pictured=True)
    assert is_idea("dance", [], bag, is_pictured=False) and not is_idea("dance", ["dance"], bag, is_pictured=False)
    assert not is_idea("teapot", [], bag, is_pictured=False) and not is_idea("violinist", [], bag, is_pictured=False)
