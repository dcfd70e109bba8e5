import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from frida_painter.mixing import Finish
from frida_painter.mixing.paint import film_over, inside, mix_reflectance, ratio, reflectance

positive = st.floats(0.01, 5)


def t(*numbers: float) -> torch.Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


@given(positive, positive)
def test_absorption_over_scattering_comes_back_from_what_is_seen(absorption: float, scattering: float) -> None:
    seen = reflectance(t(absorption), t(scattering))
    assert float(ratio(seen)) == pytest.approx(absorption / scattering, rel=1e-6, abs=1e-6) or float(seen) < 0.04


@given(positive, positive, st.floats(0.1, 9))
def test_a_paint_mixed_with_itself_stays_what_it_is(absorption: float, scattering: float, parts: float) -> None:
    k, s = t(absorption)[None].repeat(2, 1), t(scattering)[None].repeat(2, 1)
    alone = reflectance(t(absorption), t(scattering))
    assert torch.allclose(mix_reflectance(t(parts, 1.0)[None], k, s)[0], alone)


@given(positive, positive, positive, positive, st.floats(0.05, 0.95))
def test_a_mixture_lies_between_its_paints(k1: float, s1: float, k2: float, s2: float, share: float) -> None:
    one, other = reflectance(t(k1), t(s1)), reflectance(t(k2), t(s2))
    between = mix_reflectance(t(share, 1 - share)[None], t(k1, k2)[:, None], t(s1, s2)[:, None])[0]
    assert float(torch.minimum(one, other)) - 1e-9 <= float(between) <= float(torch.maximum(one, other)) + 1e-9


def test_gloss_is_deeper_than_matte_and_black_most_of_all() -> None:
    k, s = t(5.0, 0.01), t(0.4, 1.0)
    matte, gloss = reflectance(k, s), reflectance(k, s, Finish.gloss)
    assert bool((gloss < matte).all())
    assert float(gloss[0] / matte[0]) < 0.5 < 0.9 < float(gloss[1] / matte[1])


def test_what_is_darker_than_any_surface_is_black_within() -> None:
    assert float(inside(t(0.0))) == float(inside(t(0.035))) == 1e-3


@given(st.floats(0.05, 2), st.floats(0.3, 3))
def test_a_film_over_white_and_black_tells_both_constants(absorption: float, scattering: float) -> None:
    """Against the hyperbolic solution, written down once more the other way round."""
    a = 1 + absorption / scattering
    b = (a * a - 1) ** 0.5
    coth = b / torch.tanh(t(b * scattering))

    def over(ground: float) -> torch.Tensor:
        within = (1 - ground * (a - coth)) / (a - ground + coth)
        return 0.035 + 0.965 * 0.4 * within / (1 - 0.6 * within)

    white = t(0.95)
    found = film_over(over(float(inside(white))), over(0.0), white)
    assert float(found[0]) == pytest.approx(absorption, rel=2e-2)
    assert float(found[1]) == pytest.approx(scattering, rel=2e-2)
