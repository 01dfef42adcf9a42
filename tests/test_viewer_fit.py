"""Which pixel a click is on, in windows of other shapes than the picture."""

import itertools

import pytest

from warprt.viewer.fit import Window, fitted, pixel_at, point_of

SIZE = (640, 480)
WIDE, TALL = (1000, 300), (300, 900)
CORNERS_AND_MIDDLE = [(0, 0), (639, 0), (0, 479), (639, 479), (320, 240)]


@pytest.mark.parametrize("ratio", [1, 1.5, 2])
@pytest.mark.parametrize("shape", [WIDE, TALL, (487.34375, 547.8125)])
def test_picture_fills_one_side_and_keeps_its_shape(shape, ratio):
    window = Window(*shape, ratio)
    place, (across, down) = fitted(window, SIZE), window.device_size
    assert place.width == across or place.height == down
    assert place.left >= 0
    assert place.top >= 0
    assert abs(across - place.width - 2 * place.left) <= 1
    assert abs(down - place.height - 2 * place.top) <= 1
    assert abs(place.width / place.height - 640 / 480) < 2 / min(place.width, place.height)


@pytest.mark.parametrize("pixel", CORNERS_AND_MIDDLE)
@pytest.mark.parametrize("ratio", [1, 2])
@pytest.mark.parametrize("shape", [WIDE, TALL])
def test_click_in_the_middle_of_a_pixel_is_on_it(shape, ratio, pixel):
    window = Window(*shape, ratio)
    assert pixel_at(window, SIZE, *point_of(window, SIZE, pixel)) == pixel


@pytest.mark.parametrize("ratio", [1, 2])
def test_corner_pixels_by_hand(ratio):
    # 640 x 480 in 1000 x 300 is 400 x 300, with 300 to the left and right; a pixel is 0.625 wide.
    window = Window(*WIDE, ratio)
    assert pixel_at(window, SIZE, 300.0, 0.0) == (0, 0)
    assert pixel_at(window, SIZE, 300.62, 0.62) == (0, 0)
    assert pixel_at(window, SIZE, 300.63, 0.63) == (1, 1)
    assert pixel_at(window, SIZE, 699.99, 299.99) == (639, 479)
    assert pixel_at(window, SIZE, 500.0, 150.0) == (320, 240)
    # 300 x 900: 300 x 225, with 337.5 above; where pixels of the window are whole, half a one is left over.
    top = {1: 337.0, 2: 337.5}[ratio]
    assert pixel_at(Window(*TALL, ratio), SIZE, 0.0, top) == (0, 0)
    assert pixel_at(Window(*TALL, ratio), SIZE, 0.0, top - 0.01) is None


@pytest.mark.parametrize("x, y", [(299.9, 150), (700.1, 150), (-5, 150), (500, -0.1), (500, 300.1)])
def test_beside_the_picture_is_no_pixel(x, y):
    assert pixel_at(Window(*WIDE), SIZE, x, y) is None


def test_every_pixel_of_a_small_picture_in_a_window_that_is_smaller_still():
    size, window = (13, 7), Window(5.5, 4.25, 1.25)
    points = [point_of(window, size, pixel) for pixel in itertools.product(range(13), range(7))]
    assert [pixel_at(window, size, *point) for point in points] == list(itertools.product(range(13), range(7)))


@pytest.mark.parametrize("window", [(0, 5, 1), (5, -1, 1), (5, 5, 0), (float("nan"), 5, 1), (5, float("inf"), 1)])
def test_window_that_is_none_is_refused(window):
    with pytest.raises(ValueError, match="window"):
        Window(*window)


def test_click_that_is_no_number_is_refused():
    for x in (float("nan"), "left", None):
        with pytest.raises(ValueError, match="click x"):
            pixel_at(Window(5, 5), SIZE, x, 1)
