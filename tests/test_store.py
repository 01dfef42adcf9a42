"""What is kept on a disk of work that is not done, and work on more than memory holds."""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import ready
from hypothesis import given
from hypothesis import strategies as st
from test_cli import CFG, ROOT, run

import warprt as rt
from warprt import farm, tiff, tiled_rendering
from warprt.spans import Spans
from warprt.store import Store
from warprt.summary import Summary
from warprt.tiles import RayTile

RENDER = ("render", "ball.cfg", "--size", "40x30", "--device", "cpu", "--workers", "2", "--tile", "800")


def tile(first, count):
    return RayTile(first, count, "cast", None, None, ())


@contextmanager
def opened(folder, terms=(("scene", "a"), ("size", 3)), others=()):
    store = Store(folder, 10)
    try:
        assert store.begin(dict(terms)) == list(others)
        yield store
    finally:
        store.close()


def filled(folder, rng):
    arrays = {"t": rng.uniform(size=(10, 3)), "hit": rng.uniform(size=10) < 0.5}
    with opened(folder) as store:
        for first, count in ((6, 4), (0, 2), (2, 4)):
            store.put(tile(first, count), {name: values[first : first + count] for name, values in arrays.items()})
    return arrays


def test_rows_come_back_in_any_process(tmp_path, rng):
    arrays = filled(tmp_path / "s", rng)
    with opened(tmp_path / "s") as store:
        assert len(store.done) == 10
        assert store.has(tile(6, 4))
        for name, values in arrays.items():
            np.testing.assert_array_equal(store.rows(1, 7)[name], values[1:8])
            np.testing.assert_array_equal(np.load(tmp_path / "s" / f"{name}.npy"), values)
        store.finish()
    assert sorted(path.name for path in (tmp_path / "s").iterdir()) == ["hit.npy", "t.npy"]


def test_other_terms_are_named_and_nothing_is_taken(tmp_path, rng):
    filled(tmp_path / "s", rng)
    other = {"scene": "b", "samples": 1, "size": 3}
    with opened(tmp_path / "s", other, ["samples", "scene"]) as store:
        assert len(store.done) == 0
        assert not store.is_begun
        store.remove()
    assert not (tmp_path / "s").exists()
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "thesis.txt").write_text("")
    with pytest.raises(ValueError, match="exists already, and is not of unfinished work"):
        Store(tmp_path / "s", 10).begin({})
    assert [path.name for path in (tmp_path / "s").iterdir()] == ["thesis.txt"]


def test_one_process_at_a_time_has_a_folder(tmp_path, rng):
    with (
        opened(tmp_path / "s"),
        pytest.raises(BlockingIOError, match=r"another process is at work on \S+s: wait for it"),
        opened(tmp_path / "s"),
    ):
        pass
    with opened(tmp_path / "s") as store:
        # It goes with what it was for, and a new one can be begun.
        store.remove()
        with opened(tmp_path / "s") as other:
            other.put(tile(0, 1), {"t": np.zeros(1)})


def test_folder_that_cannot_be_begun_is_not_left(tmp_path, monkeypatch):
    monkeypatch.setattr(rt.store, "write_whole", full_disk)
    with pytest.raises(OSError, match="No space left"):
        Store(tmp_path / "s", 10).begin({})
    assert not (tmp_path / "s").exists()


def test_what_a_killed_process_leaves_is_cleared_away(tmp_path, rng):
    filled(tmp_path / "s", rng)
    for name in (".t.npy.abc", ".terms.json.xyz"):
        (tmp_path / "s" / name).write_bytes(b"half")
    os.truncate(tmp_path / "s" / "t.npy", 150)
    with opened(tmp_path / "s") as store:
        # Without all of one array, no row of the others is whole.
        assert len(store.done) == 0
        arrays = {"t": rng.uniform(size=(10, 3)), "hit": np.ones(10, bool)}
        store.put(tile(0, 10), arrays)
        np.testing.assert_array_equal(store.rows(0, 10)["t"], arrays["t"])
        store.remove()
    assert not (tmp_path / "s").exists()
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / ".terms.json.xyz").write_bytes(b"half")
    with opened(tmp_path / "s") as store:
        store.put(tile(0, 10), arrays)
        store.finish()
    assert sorted(path.name for path in (tmp_path / "s").iterdir()) == ["hit.npy", "t.npy"]


@pytest.mark.parametrize("bad", [np.zeros((3, 3)), np.zeros((2, 3), np.float32), np.zeros((2, 4))])
def test_results_that_do_not_fit_are_refused(tmp_path, rng, bad):
    filled(tmp_path / "s", rng)
    with opened(tmp_path / "s") as store, pytest.raises(ValueError, match=r"t of rows from 4 must be float64 \(2, 3\)"):
        store.put(tile(4, 2), {"t": bad, "hit": np.zeros(2, bool)})


def test_file_that_is_cut_off_meanwhile_is_said(tmp_path, rng):
    filled(tmp_path / "s", rng)
    with opened(tmp_path / "s") as store:
        os.truncate(tmp_path / "s" / "t.npy", 200)
        with pytest.raises(OSError, match=r"t\.npy ends before row 9"):
            store.rows(0, 10)


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 8)), max_size=12), st.integers(0, 40), st.integers(0, 9))
def test_spans_are_a_set(added, first, count):
    spans, rows = Spans(), set()
    for begin, length in added:
        spans.add(begin, length)
        rows |= set(range(begin, begin + length))
    assert len(spans) == len(rows)
    assert spans.covers(first, count) == (count > 0 and rows >= set(range(first, first + count)))


def test_what_was_half_written_or_spoilt_is_done_again(tmp_path, rng):
    filled(tmp_path / "s", rng)
    journal = tmp_path / "s" / "journal.txt"
    lines = [line for line in journal.read_text().splitlines(keepends=True) if line.strip()]
    journal.write_text("".join(lines[:2]) + lines[2][:20])
    array = np.load(tmp_path / "s" / "t.npy", mmap_mode="r+")
    array[7] += 1
    array.flush()
    with opened(tmp_path / "s") as store:
        assert (len(store.done), store.has(tile(0, 2))) == (2, True)
        # What comes after the line that was cut off is not lost with it.
        store.put(tile(2, 4), {"t": rng.uniform(size=(4, 3)), "hit": np.ones(4, bool)})
    with opened(tmp_path / "s") as store:
        assert (len(store.done), store.has(tile(0, 6))) == (6, True)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "ball.cfg").write_text(CFG)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def in_process(monkeypatch):
    """Without processes, which take seconds to start: for tests of what is kept, not of who makes it."""
    monkeypatch.setattr(tiled_rendering, "WorkerPool", lambda *_: farm.InProcess())


@pytest.mark.usefixtures("in_process")
def test_command_with_workers_writes_the_same_files(folder, capfd):
    plain = RENDER[: RENDER.index("--workers")]
    for options in ((), ("--outputs", "color,depth,samples"), ("--turntable", "2", "-o", "w.gif")):
        assert run(*plain, "-o", "whole.png", *(o.replace("w.gif", "whole.gif") for o in options)) == 0
        assert run(*RENDER, "-o", "w.png", *options) == 0
        assert "by 1 workers, 0 retries" in capfd.readouterr().out
    names = {path.name for path in folder.iterdir()} - {"ball.cfg"}
    whole = {name for name in names if name.startswith("whole")}
    assert {name.replace("whole", "w") for name in whole} == names - whole
    for name in whole:
        if not name.endswith("npz"):
            assert (folder / name).read_bytes() == (folder / name.replace("whole", "w")).read_bytes(), name
    with np.load("whole.npz") as one, np.load("w.npz") as other:
        for name in one:
            np.testing.assert_array_equal(one[name], other[name])


def interrupt(monkeypatch, error, calls):
    """An error in the midst of the work, once."""
    put, left = Store.put, [calls]

    def putting(store, *result):
        left[0] -= 1
        if left[0] == -1:
            raise error
        put(store, *result)

    monkeypatch.setattr(Store, "put", putting)
    return left


@pytest.mark.parametrize(
    ("error", "status", "rows", "words"),
    [
        # The tile that had come while the interrupted one was written is kept too.
        (
            KeyboardInterrupt(),
            130,
            20,
            "interrupted; 20 of 30 rows are kept in ball.tiles, and the same command goes on",
        ),
        (
            OSError(28, "No space left on device"),
            2,
            15,
            "No space left on device; 15 of 30 rows are kept in ball.tiles",
        ),
    ],
)
@pytest.mark.usefixtures("in_process")
def test_same_command_goes_on(folder, monkeypatch, capfd, error, status, rows, words):
    assert run(*RENDER, "-o", "whole.png") == 0
    interrupt(monkeypatch, error, 3)
    assert run(*RENDER) == status
    assert words in capfd.readouterr().err.strip().splitlines()[-1]
    left = interrupt(monkeypatch, None, 1000)
    assert run(*RENDER) == 0
    assert left[0] == 1000 - (30 - rows) // 5
    assert f"goes on, {rows} of 30 rows are in ball.tiles" in capfd.readouterr().err
    assert (folder / "ball.png").read_bytes() == (folder / "whole.png").read_bytes()
    assert not (folder / "ball.tiles").exists()


@pytest.mark.usefixtures("in_process")
def test_sigterm_keeps_what_is_done(folder, monkeypatch, capfd):
    """Batch systems end work so."""
    put = Store.put

    def put_and_end(store, *result):
        put(store, *result)
        os.kill(os.getpid(), signal.SIGTERM)

    monkeypatch.setattr(Store, "put", put_and_end)
    before = signal.getsignal(signal.SIGTERM)
    assert run(*RENDER) == 130
    assert signal.getsignal(signal.SIGTERM) is before
    assert "interrupted; 10 of 30 rows are kept in ball.tiles" in capfd.readouterr().err


@pytest.mark.usefixtures("in_process")
def test_tiles_of_another_size_are_used_where_they_cover(folder, monkeypatch, capfd):
    assert run(*RENDER, "-o", "whole.png") == 0
    interrupt(monkeypatch, OSError(28, "full"), 3)  # 15 rows, 5 at a time
    assert run(*RENDER) == 2
    left = interrupt(monkeypatch, None, 1000)
    assert run(*RENDER, "--tile", "1280") == 0  # 8 rows at a time: one of four tiles is there
    assert left[0] == 1000 - 3
    assert (folder / "ball.png").read_bytes() == (folder / "whole.png").read_bytes()


@pytest.mark.usefixtures("in_process")
def test_interrupt_before_anything_is_done_leaves_nothing(folder, monkeypatch, capfd):
    monkeypatch.setattr(farm, "run_tile", stop)
    assert run(*RENDER) == 130
    assert capfd.readouterr().err.strip().splitlines()[-1] == "warprt: interrupted"
    assert not (folder / "ball.tiles").exists()


@pytest.mark.usefixtures("in_process")
def test_full_disk_at_the_end_keeps_everything(folder, monkeypatch, capfd):
    monkeypatch.setattr(tiled_rendering, "write_picture", full_disk)
    assert run(*RENDER) == 2
    assert "No space left on device; 30 of 30 rows are kept in ball.tiles" in capfd.readouterr().err
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    assert run(*RENDER) == 0
    assert "goes on, 30 of 30 rows" in capfd.readouterr().err
    assert (folder / "ball.png").exists()


def stop(*_):
    raise KeyboardInterrupt


def full_disk(*_):
    raise OSError(28, "No space left on device")


@pytest.mark.usefixtures("in_process")
def test_changed_scene_is_noticed_not_mixed(folder, monkeypatch, capfd):
    interrupt(monkeypatch, KeyboardInterrupt(), 3)
    assert run(*RENDER) == 130
    (folder / "ball.cfg").write_text(CFG.replace("sphere { }", "sphere { radius = 1.5; }"))
    assert run(*RENDER, "--resume") == 2
    assert "ball.tiles was begun with another scene; leave out --resume" in capfd.readouterr().err
    assert run(*RENDER) == 0
    assert "ball.tiles was begun with another scene; begins anew" in capfd.readouterr().err
    assert run(*RENDER, "-o", "whole.png") == 0
    assert (folder / "ball.png").read_bytes() == (folder / "whole.png").read_bytes()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scheduler", "tcp://x:1"), "leave out one"),
        (("--tile", "0.5"), "tile must be an integer"),
        (("--workers", "-1"), "workers must be an integer"),
        (("--device", "cuda:1"), "--device must be cpu or cuda, and CUDA_VISIBLE_DEVICES says which; got cuda:1"),
    ],
)
def test_mistakes_are_one_line(folder, capfd, options, words):
    assert run(*RENDER, *options) == 2
    (line,) = capfd.readouterr().err.strip().splitlines()
    assert words in line


def test_command_whose_process_is_killed_goes_on(folder, monkeypatch):
    """By the system, without a word of warning."""
    (folder / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder / "temporary"))
    command = [sys.executable, "-m", "warprt", *RENDER, "--samples", "64", "--tile", "2560"]
    environment = {**os.environ, "PYTHONPATH": ROOT, "TMPDIR": str(folder / "temporary")}
    assert run(*command[3:], "-o", "whole.png") == 0
    assert not list((folder / "temporary").glob("warprt-*"))
    process = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True)
    journal = folder / "ball.tiles" / "journal.txt"
    while not (journal.is_file() and journal.read_text()) and process.poll() is None:
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    with pytest.raises(ProcessLookupError):
        # Its workers end too.
        for _ in range(600):
            os.killpg(process.pid, 0)
            time.sleep(0.1)
    assert journal.read_text()
    assert not (folder / "ball.png").exists()
    # It could not remove its scene.
    assert len(list((folder / "temporary").glob("warprt-*"))) == 1
    assert run(*command[3:]) == 0
    assert (folder / "ball.png").read_bytes() == (folder / "whole.png").read_bytes()
    assert not list((folder / "temporary").glob("warprt-*"))


@pytest.mark.usefixtures("in_process")
def test_adaptive_tiles_are_those_of_the_whole_picture(folder, capfd):
    options = ("--noise", "0.05", "--samples", "64", "--outputs", "color,samples")
    assert run(*RENDER, *options, "-o", "tiles.png") == 0
    assert f"at most {40 * 30 * 64:,} camera rays" in capfd.readouterr().out
    assert run(*RENDER[: RENDER.index("--workers")], *options, "-o", "whole.png") == 0
    with np.load("tiles.npz") as tiles, np.load("whole.npz") as whole:
        for name in ("color", "samples"):
            np.testing.assert_array_equal(tiles[name], whole[name])
    assert (folder / "tiles.png").read_bytes() == (folder / "whole.png").read_bytes()


@pytest.mark.usefixtures("in_process")
def test_large_tiff_is_the_same_picture(folder, monkeypatch, capfd):
    tifffile = pytest.importorskip("tifffile")
    assert run(*RENDER, "-o", "small.png", "--size", "600x300") == 0
    monkeypatch.setattr(tiff, "LARGE", 600 * 300)
    assert run("render", "ball.cfg", "--size", "600x300", "--device", "cpu", "-o", "large.tif") == 0
    import PIL.Image

    with PIL.Image.open("small.png") as small, tifffile.TiffFile("large.tif") as large:
        assert large.pages[0].is_tiled
        np.testing.assert_array_equal(large.asarray(), np.asarray(small))
    assert run("render", "ball.cfg", "--size", "600x300", "-o", "large.tif", "--outputs", "depth") == 2
    assert "holds colour only; got --outputs depth" in capfd.readouterr().err
    monkeypatch.setattr(tiff.importlib.util, "find_spec", lambda name: None)
    assert run("render", "ball.cfg", "--size", "600x300", "-o", "large.tif") == 2
    assert "pip install 'warprt[tiff]'" in capfd.readouterr().err


@pytest.fixture(scope="module")
def tracer():
    return rt.Tracer(ready.load("sphereflake"), device="cpu")


@pytest.fixture
def rays(rng):
    return rng.normal(size=(5000, 6)).astype(np.float32) * 3


@pytest.mark.parametrize("query", ["cast", "occluded", "count"])
def test_rays_of_a_file_get_the_same_bits(tmp_path, tracer, rays, query):
    np.save(tmp_path / "rays.npy", rays)
    done = []
    summary = rt.cast_file(
        tracer, tmp_path / "rays.npy", tmp_path / "hits", query, tile=700, progress=lambda *counts: done.append(counts)
    )
    assert summary.tiles.total() == 8
    assert done[-1] == (5000, 5000)
    whole = getattr(tracer, query)(rays[:, :3], rays[:, 3:])
    expected = {name: getattr(whole, name) for name in rt.hits.FIELDS} if query == "cast" else {query: whole}
    assert {path.stem for path in (tmp_path / "hits").iterdir()} == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(np.load(tmp_path / "hits" / f"{name}.npy"), values)


def test_other_rays_of_the_same_shape_are_noticed(tmp_path, tracer, rays, monkeypatch):
    interrupt(monkeypatch, OSError(28, "No space left on device"), 3)
    with pytest.raises(OSError, match="No space left"):
        rt.cast_file(tracer, rays, tmp_path / "hits", tile=700)
    monkeypatch.undo()
    rays[1] = rays[2]
    with pytest.raises(ValueError, match="was begun with another rays"):
        rt.cast_file(tracer, rays, tmp_path / "hits", tile=700)


@pytest.mark.parametrize(
    ("rays", "options", "words"),
    [
        ("none.npz", {}, r"rays must be an \.npy file or an array; got none\.npz"),
        ("text.npy", {}, r"text\.npy is no \.npy file of numbers, or is cut off"),
        ("good.npy", {"outputs": ()}, "outputs must name at least one"),
        ("good.npy", {"executor": 4}, r"must be a concurrent\.futures\.Executor; got int"),
        ("good.npy", {"progress": 3}, "progress must be a function; got 3"),
        ("good.npy", {"t_max": np.nan}, "t_min and t_max must be one number each"),
    ],
)
def test_mistakes_are_found_before_anything_is_made(tmp_path, monkeypatch, tracer, rays, options, words):
    monkeypatch.chdir(tmp_path)
    np.save("good.npy", np.ones((10, 6)))
    np.savez("none.npz", a=1)
    Path("text.npy").write_text("not an array")
    with pytest.raises(ValueError, match=words):
        rt.cast_file(tracer, rays, "hits", **options)
    assert not Path("hits").exists()


def test_damaged_notes_are_said_or_passed_over(tmp_path, rng):
    filled(tmp_path / "s", rng)
    with open(tmp_path / "s" / "journal.txt", "ab") as journal:
        journal.write(b"\n\xff\xfe 3 abc\n8 700 abc\n-4 2 abc\n")
    with opened(tmp_path / "s") as store:
        assert len(store.done) == 10
    for damaged in ("", "[1]"):
        (tmp_path / "s" / "terms.json").write_text(damaged)
        with pytest.raises(ValueError, match=r"terms\.json is damaged: remove \S+s$"), opened(tmp_path / "s"):
            pass


def test_progress_ends_at_the_total_whatever_the_tiles(tmp_path, tracer, rays, monkeypatch):
    interrupt(monkeypatch, OSError(28, "No space left on device"), 3)
    with pytest.raises(OSError, match="No space left"):
        rt.cast_file(tracer, rays, tmp_path / "hits", tile=700)
    monkeypatch.undo()
    done = []
    rt.cast_file(tracer, rays, tmp_path / "hits", tile=1000, progress=lambda *counts: done.append(counts))
    # Rows 0 to 2099 were there: two tiles, and 100 rows of the third.
    assert done == [(3000, 5000), (4000, 5000), (5000, 5000)]


def test_rays_go_on_where_they_were_cut_off(tmp_path, tracer, rays, monkeypatch):
    path, folder = tmp_path / "rays.npy", tmp_path / "hits"
    np.save(path, rays)
    interrupt(monkeypatch, OSError(28, "No space left on device"), 3)
    with pytest.raises(OSError, match="No space left"):
        rt.cast_file(tracer, path, folder, outputs="t", tile=700)
    with pytest.raises(ValueError, match="begun with another outputs: remove it"):
        rt.cast_file(tracer, path, folder, outputs="hit", tile=700)
    with rt.WorkerPool(1) as pool:
        summary = rt.cast_file(tracer, path, folder, outputs="t", tile=700, executor=pool)
    assert summary.tiles.total() == 5
    np.testing.assert_array_equal(np.load(folder / "t.npy"), tracer.cast(rays[:, :3], rays[:, 3:], outputs="t").t)
    with pytest.raises(ValueError, match="exists already"):
        rt.cast_file(tracer, path, folder, outputs="t")


def test_rays_of_other_kinds(tmp_path, tracer, rays):
    class Sliced:
        """Like an array of Zarr: it is read by slices."""

        shape, dtype = rays.shape, rays.dtype

        def __getitem__(self, rows):
            asked.append(rows)
            return rays[rows]

    asked = []

    rt.cast_file(tracer, Sliced(), tmp_path / "a", "count", tile=2000)
    # Single rows are looked at to know these rays again.
    assert [s for s in asked if s.stop - s.start > 1] == [slice(0, 2000), slice(2000, 4000), slice(4000, 5000)]
    np.save(tmp_path / "bad.npy", rays[:, :5])
    for bad, words in (
        (tmp_path / "bad.npy", r"shape \(n, 6\); got float32 \(5000, 5\)"),
        ([[1, 2]], "or an array; got list"),
    ):
        with pytest.raises(ValueError, match=words):
            rt.cast_file(tracer, bad, tmp_path / "b")
    with pytest.raises(FileNotFoundError):
        rt.cast_file(tracer, tmp_path / "none.npy", tmp_path / "b")
    with pytest.raises(ValueError, match="query must be one of cast, occluded, count; got 'walk'"):
        rt.cast_file(tracer, rays, tmp_path / "b", "walk")
    rt.cast_file(tracer, rays[:0], tmp_path / "none", outputs=("t", "instance_id"))
    for name, dtype in (("t", np.float32), ("instance_id", np.int32)):
        none = np.load(tmp_path / "none" / f"{name}.npy")
        assert (none.shape, none.dtype) == ((0,), dtype)


def test_rays_of_zarr(tmp_path, tracer, rays):
    zarr = pytest.importorskip("zarr")
    stored = zarr.create_array(tmp_path / "rays.zarr", shape=rays.shape, dtype=rays.dtype, chunks=(999, 6))
    stored[:] = rays
    rt.cast_file(tracer, zarr.open_array(tmp_path / "rays.zarr", mode="r"), tmp_path / "hits", "occluded", tile=700)
    whole = tracer.occluded(rays[:, :3], rays[:, 3:])
    np.testing.assert_array_equal(np.load(tmp_path / "hits" / "occluded.npy"), whole)


MEMORY = """
import resource, sys
import numpy as np, warprt as rt
from warprt.quiet import start_warp

start_warp()
tracer = rt.Tracer(rt.Scene([rt.Sphere()]), device="cpu", threads=1)
rays = np.lib.format.open_memmap("rays.npy", "w+", np.float32, (int(sys.argv[1]), 6))
rays[:1] = (0, 0, 5, 0, 0, -1)
del rays
rt.cast_file(tracer, "rays.npy", "small", "occluded", tile=1 << 16)
"""


def test_memory_does_not_grow_with_the_rays(tmp_path):
    """24 bytes each: forty times as many rays are 38 MB more to read."""

    def peak(count):
        folder = tmp_path / str(count)
        folder.mkdir()
        program = MEMORY + "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
        environment = {**os.environ, "PYTHONPATH": ROOT}
        command = [sys.executable, "-c", program, str(count)]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return int(done.stdout) * 1024

    few, many = peak(1 << 17), peak(40 << 16)
    assert Path(tmp_path / str(40 << 16) / "rays.npy").stat().st_size > 60e6
    assert many - few < 20e6


def test_summary_says_who_did_what():
    summary = Summary(retries=1)
    for worker, count in (("b", 2), ("a", 1)):
        for k in range(count):
            summary.add(10, worker, 0.5, k == 0)
    assert str(summary).splitlines() == [
        "a: 1 tiles in 0.50 s of work, scene unpacked 1 x",
        "b: 2 tiles in 1.00 s of work, scene unpacked 1 x",
        "3 tiles by 2 workers, 1 retry",
    ]
    assert summary.rays == 30
