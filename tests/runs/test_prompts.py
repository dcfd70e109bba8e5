import pytest
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.errors import ConfigError
from frida_painter.runs.prompts import name_of, read_prompt, title_of


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("a sailing ship", "a sailing ship"),
        ("  a\tsailing\n ship ", "a sailing ship"),
        ("🍓", "strawberry"),
        ("a red 🍓!", "a red strawberry !"),
        ("❤️", "heavy black heart"),
        ("café à la crème", "café à la crème"),
        ("<script>alert(1)</script>", "<script>alert(1)</script>"),
        ("x" * 10_000, "x" * 10_000),
    ],
)
def test_words_become_one_plain_line(text: str, read: str) -> None:
    assert read_prompt(text, "--text") == read


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "was given no words"),
        (" \n\t ", "was given no words"),
        ("x" * 10_001, "at most 10000"),
        ("a \x1b[31mred\x1b[0m ship", "U\\+001B"),
        ("a ship\x00", "U\\+0000"),
        ("a \ud800", "U\\+D800"),
        ("一艘帆船", "say it in English"),
        ("!!! 123", "say it in English"),
    ],
)
def test_what_cannot_be_painted_is_refused_in_a_sentence(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as refused:
        read_prompt(text, "--text")
    assert len(str(refused.value)) < 250


@given(st.text(max_size=200))
def test_names_and_titles_are_safe_and_short(text: str) -> None:
    try:
        prompt = read_prompt(text, "--text")
    except ConfigError:
        return
    name = name_of(prompt)
    assert 1 <= len(name) <= 40 and set(name) <= set("abcdefghijklmnopqrstuvwxyz0123456789-") and name[0] != "-"
    assert len(title_of(prompt)) <= 62 and "\n" not in prompt


def test_names_do_not_leave_their_folder() -> None:
    assert name_of("../../etc/passwd") == "etc-passwd"
