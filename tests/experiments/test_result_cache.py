import torch

from frida_painter.experiments.result_cache import Measurement, ResultCache

PICTURE = torch.rand(3, 20, 20, generator=torch.Generator().manual_seed(0))


class Measuring:
    def __init__(self) -> None:
        self.times = 0

    def __call__(self) -> Measurement:
        self.times += 1
        return Measurement({"gap": 0.1 + 0.2}, {"painted": PICTURE})


def test_what_was_found_is_not_measured_again(tmp_path):
    measure = Measuring()
    ResultCache(tmp_path, {"rows": 64}).recall("cat-0", measure)
    again = ResultCache(tmp_path, {"rows": 64}).recall("cat-0", measure)
    assert measure.times == 1
    assert again.numbers == {"gap": 0.1 + 0.2}
    assert float((again.pictures["painted"] - PICTURE).abs().max()) <= 0.5 / 255 + 1e-6


def test_another_name_and_other_settings_are_measured(tmp_path):
    measure = Measuring()
    for depends_on, name in (({"rows": 64}, "a"), ({"rows": 64}, "b"), ({"rows": 65}, "a")):
        ResultCache(tmp_path, depends_on).recall(name, measure)
    assert measure.times == 3


def test_a_damaged_finding_is_measured_again(tmp_path):
    measure = Measuring()
    for damage in ("numbers", "picture", None):
        ResultCache(tmp_path, {}).recall("a", measure)
        if damage == "numbers":
            path = tmp_path / "a.json"
            path.write_text(path.read_text()[:-20])
        elif damage == "picture":
            (tmp_path / "a-painted.png").write_bytes(b"")
    assert measure.times == 3


def test_without_a_folder_nothing_is_kept():
    measure = Measuring()
    for _ in range(2):
        ResultCache(None, {}).recall("a", measure)
    assert measure.times == 2
