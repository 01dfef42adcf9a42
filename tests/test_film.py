"""Samples of a picture: how far they spread, when they are enough, and what is seen on the way."""

import numpy as np
import pytest

import warprt as rt
from warprt import progress

SIZE = (40, 28)
FILM = ("color", "variance", "samples")


def scene():
    """Soft shadows, edges, and much that is plain."""
    lamp = rt.RectangleLight((0, 4, 0), (1, 0, 0), (0, 0, 1), (9, 8, 7))
    return rt.Scene([rt.Plane(), rt.Sphere((0, 1, 0))], [lamp], rt.Camera((0, 3, 7), (0, 0.7, 0)), (0.2, 0.3, 0.5))


@pytest.fixture(scope="module")
def tracer():
    return rt.Tracer(scene(), device="cpu", threads=2)


def half():
    """A pixel of which the right half is bright."""
    wall = rt.Box((0, -9, -1), (9, 9, 0))
    lit = rt.Scene([rt.Instance(wall, material=rt.Material(0, emission=(1, 3, 0.5)))])
    return lit, rt.OrthographicCamera((0, 0, 5), (0, 0, 0), height=1)


@pytest.mark.parametrize("samples", [2, 3, 7, 100])
def test_variance_is_that_of_two_values(samples, accuracy, device):
    lit, camera = half()
    image = rt.Tracer(lit, accuracy, device).render(camera, (1, 1), samples, outputs=FILM)
    share = image["color"][0, 0, 0]
    expected = share * (1 - share) / (samples - 1) * np.array([1, 9, 0.25])
    np.testing.assert_allclose(image.variance[0, 0], expected, rtol=1e-5)
    assert image["samples"][0, 0] == samples


def test_variance_is_unknown_after_one_sample(device):
    lit, camera = half()
    assert np.isinf(rt.Tracer(lit, device=device).render(camera, (3, 2), outputs="variance").variance).all()


def test_variance_tells_the_error(tracer):
    image = tracer.render(size=SIZE, samples=64, outputs=FILM)
    truth = tracer.render(size=SIZE, samples=4096)["color"]
    # Samples are spread more evenly than by chance, so the error is less than the variance says, and not by chance.
    ratio = np.mean((image["color"] - truth) ** 2) / np.mean(image.variance)
    assert 0.01 < ratio < 1


def test_other_outputs_change_no_bit_of_the_colour(tracer):
    color = tracer.render(size=SIZE, samples=9)["color"]
    np.testing.assert_array_equal(tracer.render(size=SIZE, samples=9, outputs=(*FILM, "depth"))["color"], color)


def root_error(image):
    """The standard error in square roots of light, in double precision."""
    mean, error = image["color"].astype(float), np.sqrt(image.variance.astype(float))
    return (np.sqrt(mean + error) - np.sqrt(mean)).max(axis=-1)


def test_pixels_stop_when_they_and_their_neighbours_are_quiet(tracer):
    noise, most = 0.02, 100
    image = tracer.render(size=SIZE, samples=most, outputs=FILM, noise=noise)
    # The same once more, step by step, from pictures of so many samples in all pixels.
    counts, is_active = np.full(SIZE[::-1], most), np.ones(SIZE[::-1], bool)
    now = root_error(tracer.render(size=SIZE, samples=16, outputs=FILM))
    for count in range(16, most, 16):
        error = root_error(tracer.render(size=SIZE, samples=count, outputs=FILM))
        now = np.where(is_active, error, now)
        padded = np.pad(now, ((0, 0), (3, 3)))
        worst = np.max([padded[:, k : k + SIZE[0]] for k in range(7)], axis=0)
        # Rounded to float32, it might fall on the other side of the limit; here it does not.
        assert (np.abs(worst / noise - 1) > 1e-5).all()
        stops = is_active & (worst <= noise)
        counts[stops], is_active[stops] = count, False
    np.testing.assert_array_equal(image["samples"], counts)
    assert (counts == 16).any() and (counts == most).any() and len(np.unique(counts)) > 3
    for count in np.unique(counts):
        whole = tracer.render(size=SIZE, samples=int(count), outputs=FILM)
        for name in FILM:
            np.testing.assert_array_equal(image[name][counts == count], whole[name][counts == count])


def test_adaptive_picture_does_not_depend_on_tiles_threads_rows_or_previews(tracer):
    options = {"size": (211, 97), "samples": 40, "outputs": FILM, "noise": 0.03}
    whole = rt.Tracer(scene(), device="cpu", threads=1).render(**options)
    reports, previews = [], []
    tiled = tracer.render(
        **options,
        progress=lambda *counts: reports.append(counts),
        preview=lambda image, samples: previews.append((image, samples)),
    )
    part = tracer.render(**options, rows=(30, 9))
    for name in FILM:
        np.testing.assert_array_equal(tiled[name], whole[name])
        np.testing.assert_array_equal(part[name], whole[name][30:39])
    assert [samples for _, samples in previews] == [1, 2, 4, 8, 16, 32, 40]
    assert reports == sorted(reports) and reports[-1] == (211 * 97 * 40,) * 2


@pytest.mark.parametrize("integrator", ["whitted", "path"])
def test_previews_are_the_pictures_of_fewer_samples(tracer, integrator):
    seen = {}
    options = {"size": SIZE, "integrator": integrator, "outputs": ("color", "depth")}
    whole = tracer.render(samples=6, preview=lambda image, samples: seen.update({samples: image}), **options)
    assert list(seen) == [1, 2, 4, 6]
    for samples, image in seen.items():
        assert list(image.keys()) == ["color"]
        np.testing.assert_array_equal(image["color"], tracer.render(samples=samples, **options)["color"])
    np.testing.assert_array_equal(whole["color"], seen[6]["color"])


def test_preview_ends_the_work(tracer):
    calls = []
    image = tracer.render(
        size=SIZE, samples=1000, preview=lambda image, samples: calls.append(samples) or np.bool_(samples < 4)
    )
    assert calls == [1, 2, 4]
    np.testing.assert_array_equal(image["color"], tracer.render(size=SIZE, samples=4)["color"])


def test_quiet_pictures_end_early(device):
    plain, calls, done = rt.Tracer(rt.Scene(background=0.1), device=device), [], []
    image = plain.render(
        size=(8, 4),
        samples=1_000_000,
        noise=0.01,
        outputs=FILM,
        preview=lambda image, samples: calls.append(samples),
        progress=lambda *counts: done.append(counts),
    )
    # A million rounds would take far longer than a test may.
    assert (image["samples"] == 16).all()
    assert calls[-1] == 1_000_000
    assert done[-1] == (8 * 4 * 1_000_000,) * 2


def test_a_hundred_thousand_samples_add_up(device):
    plain = rt.Tracer(rt.Scene(background=0.1), device=device)
    image = plain.render(size=(2, 1), samples=100_000, outputs=FILM)
    np.testing.assert_allclose(image["color"], 0.1, rtol=1e-6)
    assert image.variance.max() < 1e-20


def test_progress_bar_goes_to_the_end(tracer, monkeypatch):
    bars = []

    class Bar(progress.bar_type()):
        def __init__(self, **options):
            super().__init__(**{**options, "disable": False})
            bars.append(self)

        def close(self):
            self.last = (self.n, self.total)
            super().close()

    monkeypatch.setattr(progress, "bar_type", lambda: Bar)
    tracer.render(size=SIZE, samples=5, progress=True)
    (bar,) = bars
    assert bar.last == (SIZE[0] * SIZE[1] * 5,) * 2


def test_counts_and_variance_are_drawn(tracer, tmp_path):
    image = tracer.render(size=SIZE, samples=32, outputs=FILM, noise=0.02)
    assert image.to_pil("samples").width > SIZE[0]  # by its bar
    assert np.asarray(image.to_pil("variance")).std() > 0
    image.save(tmp_path / "samples.png", "samples", bits=16)
    image.save(tmp_path / "all.npz")
    with np.load(tmp_path / "all.npz") as data:
        np.testing.assert_array_equal(data["samples"], image["samples"])


@pytest.mark.parametrize(
    "options, words",
    [
        ({"noise": 0}, "noise must be positive"),
        ({"noise": float("nan")}, "noise must be finite"),
        ({"noise": True}, "noise must be positive"),
        ({"preview": 3}, "preview must be a function; got 3"),
        ({"progress": 3}, "progress must be a function; got 3"),
        ({"noise": "low"}, "noise must be real"),
        ({"integrator": "photon"}, "integrator must be one of whitted, path; got 'photon'"),
        ({"max_bounces": -1}, "max_bounces"),
        ({"samples": 10**7}, "samples must be an integer from 1 to 1000000"),
    ],
)
def test_bad_option_is_named(tracer, options, words):
    with pytest.raises(ValueError, match=words):
        tracer.render(size=(2, 2), **options)
