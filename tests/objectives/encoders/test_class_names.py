from frida_painter.objectives.encoders.class_names import class_names, synonyms


def test_a_thousand_classes_each_with_a_name() -> None:
    names = class_names()
    assert len(names) == 1000
    assert all(name.strip() == name and name for some in names for name in some)
    assert names[437][:2] == ("beacon", "lighthouse") and names[949] == ("strawberry",) and names[0][0] == "tench"


def test_a_class_has_other_names() -> None:
    assert "lady beetle" in synonyms("ladybird") and "ladybird" not in synonyms("Ladybird")
    assert synonyms("no such thing") == []
