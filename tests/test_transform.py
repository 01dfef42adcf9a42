"""Placements composed on the host."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import warprt as rt

EPS = np.finfo(float).eps
numbers = st.floats(-100, 100)
factors = st.floats(0.01, 100) | st.floats(-100, -0.01)


def steps():
    return st.lists(
        st.one_of(
            st.tuples(st.just("translate"), st.tuples(numbers, numbers, numbers)),
            st.tuples(st.just("scale"), st.tuples(factors, factors, factors)),
            st.tuples(st.just("rotate"), st.tuples(numbers, st.tuples(factors, numbers, numbers))),
        ),
        max_size=5,
    )


@given(steps())
def test_inverse_of_composition_is_composed_from_inverses(steps):
    t = rt.Transform()
    condition = 1.0
    for name, arguments in steps:
        t = getattr(t, name)(*arguments)
        condition = np.linalg.cond(t.world_from_local)
    # Each of up to five products adds 4 roundings per element, magnified by the condition number.
    np.testing.assert_allclose(t.world_from_local @ t.local_from_world, np.eye(4), atol=64 * EPS * condition)


def test_steps_act_in_the_order_of_the_calls():
    t = rt.Transform().scale(2, 3, 4).rotate(90, (0, 0, 1)).translate(10, 0, 0)
    # S: (2, 0, 0); R: (0, 2, 0); T: (10, 2, 0)
    np.testing.assert_allclose(t.world_from_local @ [1, 0, 0, 1], [10, 2, 0, 1], atol=4 * EPS)


def test_axis_need_not_be_unit():
    np.testing.assert_allclose(
        rt.Transform().rotate(120, (7, 7, 7)).world_from_local[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=4 * EPS
    )


def test_columns_are_columns():
    t = rt.Transform.from_columns((1, 2, 3, 0), (0, 1, 0, 0), (0, 0, 1, 0), (4, 5, 6, 1))
    np.testing.assert_array_equal(t.world_from_local, [[1, 0, 0, 4], [2, 1, 0, 5], [3, 0, 1, 6], [0, 0, 0, 1]])


def test_scale_takes_one_number_three_or_a_vector():
    assert rt.Transform().scale(2) == rt.Transform().scale(2, 2, 2) == rt.Transform().scale((2, 2, 2))


def test_translate_takes_three_numbers_or_a_vector():
    assert rt.Transform().translate(1, 2, 3) == rt.Transform().translate([1, 2, 3])


def test_transform_does_not_change():
    t = rt.Transform()
    with pytest.raises(AttributeError):
        t.world_from_local = np.eye(4)
    with pytest.raises(ValueError):
        t.world_from_local[0, 0] = 2


def test_transform_survives_pickling():
    t = rt.Transform().rotate(30, (1, 2, 3)).scale(1, 2, 3)
    again = pickle.loads(pickle.dumps(t))
    assert again == t
    np.testing.assert_array_equal(again.local_from_world, t.local_from_world)


SINGULAR = np.diag([1.0, 1, 0, 1])
PROJECTIVE = np.eye(4)
PROJECTIVE[3, 0] = 0.5
ROTATED_RANK_2 = rt.Transform().rotate(33, (1, 2, 3)).world_from_local @ SINGULAR


@pytest.mark.parametrize(
    "make, words",
    [
        pytest.param(lambda: rt.Transform().scale(1, 0, 1), "scale", id="zero scale"),
        pytest.param(lambda: rt.Transform().rotate(10, (0, 0, 0)), "rotation axis", id="zero axis"),
        pytest.param(lambda: rt.Transform(SINGULAR), "singular", id="singular"),
        pytest.param(lambda: rt.Transform(np.zeros((4, 4))), "projective", id="all zeros"),
        pytest.param(lambda: rt.Transform(ROTATED_RANK_2), "singular", id="rank 2, rotated"),
        pytest.param(lambda: rt.Transform(PROJECTIVE), "projective", id="projective"),
        pytest.param(lambda: rt.Transform(np.full((4, 4), np.nan)), "finite", id="nan"),
        pytest.param(lambda: rt.Transform(np.eye(3)), "shape", id="3 by 3"),
        pytest.param(lambda: rt.Transform().translate(np.inf, 0, 0), "finite", id="infinite translation"),
        pytest.param(lambda: rt.Transform().translate(1, 2), "shape", id="two numbers"),
        pytest.param(lambda: rt.Transform().rotate("x", (0, 0, 1)), "angle_deg", id="angle not a number"),
        pytest.param(lambda: rt.Transform.from_columns((1, 0, 0), (0,) * 4, (0,) * 4, (0,) * 4), "column 0", id="col"),
    ],
)
def test_bad_transform_is_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.parametrize("factor", [1e-100, 1e100])
def test_extreme_scale_of_an_axis_is_not_singular(factor):
    m = rt.Transform().rotate(20, (1, 2, 3)).world_from_local @ np.diag([factor, 1, 1, 1])
    t = rt.Transform(m)
    # The other product, W A, adds up terms of size 1e100.
    np.testing.assert_allclose(t.world_from_local @ t.local_from_world, np.eye(4), atol=64 * EPS)
