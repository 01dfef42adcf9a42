"""Files written whole or not at all, through links, with permissions, on disks that are full."""

import errno
import os
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from test_cli import CFG, ROOT, run

import warprt as rt
from warprt import files, scratch, unfinished
from warprt.files import FileLock, write_whole

RENDER = ("render", "ball.cfg", "--size", "40x30", "--device", "cpu")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The present one, with a folder for temporary files within."""
    (tmp_path / "ball.cfg").write_text(CFG)
    (tmp_path / "temporary").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    return tmp_path


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def put(path, text="new"):
    write_whole(path, lambda file: file.write(text.encode()))


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize("is_there", [True, False])
def test_links_are_followed_and_stay(tmp_path, is_there):
    (tmp_path / "far").mkdir()
    target, first, second = tmp_path / "far" / "real.txt", tmp_path / "first.txt", tmp_path / "second.txt"
    if is_there:
        target.write_text("old")
    second.symlink_to("far/real.txt")
    first.symlink_to("second.txt")
    put(first)
    assert target.read_text() == "new"
    assert os.readlink(first) == "second.txt"
    assert os.readlink(second) == "far/real.txt"
    assert names(tmp_path / "far") == ["real.txt"]


def test_links_that_lead_nowhere_are_said(tmp_path):
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "lost").symlink_to("none/x")
    with pytest.raises(OSError, match=r"cannot write \S+loop: it is a symbolic link that leads to itself"):
        put(tmp_path / "loop")
    with pytest.raises(FileNotFoundError, match=r"cannot write \S+lost: there is no folder \S+none"):
        put(tmp_path / "lost")


def test_every_writer_follows_links(folder):
    (folder / "far").mkdir()
    scene = rt.Scene([rt.Sphere()], camera=rt.Camera((0, 0, 5)))
    image = rt.Tracer(scene, device="cpu").render(size=(4, 3))
    links = [folder / name for name in ("a.png", "a.jpg", "a.npz", "a.glb", "ball.png", "b.gif", "b.000.png", "c.png")]
    for link in links:
        link.symlink_to(f"far/{link.name}")
    (folder / "hits").symlink_to("far/hits")
    for link in links[:3]:
        image.save(link)
    scene.export(links[3])
    assert run(*RENDER) == 0
    assert run(*RENDER, "--turntable", "1", "-o", "b.gif") == 0
    assert run(*RENDER, "-o", "c.png", "--workers", "1") == 0
    rt.cast_file(rt.Tracer(scene, device="cpu"), np.ones((5, 6), np.float32), folder / "hits", outputs="t")
    assert all(link.is_symlink() and link.stat().st_size for link in [*links, folder / "hits"])
    assert names(folder / "far") == sorted(link.name for link in [*links, folder / "hits"])
    assert names(folder / "far" / "hits") == ["t.npy"]


def test_devices_and_pipes_are_written_to_and_stay(tmp_path):
    (tmp_path / "null").symlink_to("/dev/null")
    put(tmp_path / "null")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)
    os.mkfifo(tmp_path / "pipe")
    read = []
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    reader.start()
    put(tmp_path / "pipe")
    reader.join()
    assert read == ["new"]
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


def test_permissions_are_those_of_new_files_or_stay(tmp_path, monkeypatch):
    (tmp_path / "private").write_text("old")
    (tmp_path / "private").chmod(0o640)
    program = (
        f"import os; os.umask(0o027); import sys; sys.path[:] = {sys.path!r}; from warprt.files import write_whole"
    )
    write = "; write_whole('new', lambda file: file.write(b'new'))"
    subprocess.run([sys.executable, "-c", program + write], cwd=tmp_path, check=True)
    assert mode(tmp_path / "new") == 0o640
    # The mask is one for all threads, so nobody may change it, even for a moment.
    monkeypatch.setattr(os, "umask", None)
    put(tmp_path / "private")
    assert mode(tmp_path / "private") == 0o640
    assert (tmp_path / "private").read_text() == "new"


def test_what_a_killed_process_leaves_is_written_over(tmp_path):
    program = "import os, signal, sys; from warprt.files import write_whole; "
    program += "write_whole('x', lambda file: (file.write(bytes(100_000)), os.kill(os.getpid(), signal.SIGKILL)))"
    environment = {**os.environ, "PYTHONPATH": ROOT}
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment)
    assert done.returncode == -signal.SIGKILL
    assert names(tmp_path) == [".x.part"]
    put(tmp_path / "x")
    assert names(tmp_path) == ["x"]


def test_two_write_at_once(tmp_path):
    def write(file):
        put(tmp_path / "x", "inner")
        assert (tmp_path / "x").read_text() == "inner"
        file.write(b"outer")

    write_whole(tmp_path / "x", write)
    assert (tmp_path / "x").read_text() == "outer"
    assert names(tmp_path) == ["x"]


def test_cut_off_file_is_no_success(tmp_path):
    """Pillow alone overlooks it, for some kinds of files."""
    resource = pytest.importorskip("resource")
    picture = PIL.Image.fromarray(np.random.default_rng(0).integers(0, 255, (100, 100, 3), np.uint8))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
        for name in ("a.png", "a.jpg", "a.bmp"):
            with pytest.raises(OSError, match=rf"cannot write \S+{name}: File too large") as caught:
                rt.image.write_picture(tmp_path / name, picture, rt.image.file_kind(name))
            assert caught.value.errno == errno.EFBIG
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert names(tmp_path) == []


@pytest.fixture
def full(folder, monkeypatch):
    """The disk of the folder is full; that for temporary files is another one, until its name is put in the list."""
    disks, write_beside = [folder], files._write_beside

    def write(target, *arguments):
        if target.resolve().parent in disks:
            raise OSError(errno.ENOSPC, "No space left on device")
        write_beside(target, *arguments)

    monkeypatch.setattr(files, "_write_beside", write)
    return disks


@pytest.mark.parametrize("options", [(), ("--turntable", "2", "-o", "ball.gif")])
def test_finished_picture_outlives_a_full_disk(folder, full, capfd, options):
    output = options[-1] if options else "ball.png"
    assert run(*RENDER, *options) == 2
    err = capfd.readouterr().err.strip().splitlines()[-1]
    (kept,) = (folder / "temporary").iterdir()
    assert err.startswith(f"warprt: cannot write {'ball.000.png' if options else output}: No space left on device; ")
    assert f"30 of 30 rows are kept in {kept}; to continue: warprt render ball.cfg" in err
    full.clear()
    assert run(*RENDER, *options, "--resume") == 0
    assert names(folder / "temporary") == []
    assert run(*RENDER, *options[:-1], *(["whole.gif"] if options else ["-o", "whole.png"])) == 0
    assert (folder / output).read_bytes() == (folder / f"whole{Path(output).suffix}").read_bytes()


def test_nothing_is_kept_where_there_is_no_room_at_all(folder, full, capfd):
    full.append(folder / "temporary")
    assert run(*RENDER) == 2
    err = capfd.readouterr().err.strip().splitlines()[-1]
    assert err.startswith("warprt: cannot write ball.png: No space left on device; what is done cannot be kept: cannot")


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files without owners")
def test_what_others_put_into_the_folder_for_temporary_files_stays(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    (tmp_path / "precious").write_bytes(b"precious")
    work = unfinished.Unfinished(tmp_path / "gone" / "a.npz", {"color": np.zeros((2, 2, 3), np.float32)}, dict)
    work._aside.symlink_to(tmp_path / "precious")
    with pytest.raises(OSError, match="what stands there is a link, or not a file of yours"):
        work.save()
    assert (tmp_path / "precious").read_bytes() == b"precious" and work._aside.is_symlink()
    work._aside.unlink()
    files.write_whole(work._aside, lambda file: file.write(b"new"), follow=False)
    assert work._aside.read_bytes() == b"new"
    monkeypatch.setattr(os, "geteuid", lambda: -1)
    with pytest.raises(OSError, match="not a file of yours"):
        work.save()
    assert work._aside.read_bytes() == b"new"


@pytest.mark.filterwarnings("default")
def test_full_disk_does_not_end_work_that_is_not_done(folder, full, monkeypatch, capfd):
    """What is saved now and then is for an interrupt that may not come."""
    full.append(folder / "temporary")
    monkeypatch.setattr(unfinished, "SECONDS_BETWEEN_SAVES", -1.0)
    monkeypatch.setattr(rt.rendering.Job, "_save", lambda job, image: full.clear())
    assert run(*RENDER) == 0
    assert "warning: an interrupt would lose what is done: cannot write" in capfd.readouterr().err


def test_folders_of_killed_processes_are_removed(folder):
    place = folder / "temporary"
    for name in ("warprt-dead", "warprt-live", "warprt-other"):
        (place / name).mkdir()
        (place / name / ("notes" if name == "warprt-other" else scratch.LOCK)).touch()
    (place / "warprt-link").symlink_to(folder)
    live = FileLock(place / "warprt-live" / scratch.LOCK)
    live.take("in use")
    with scratch.scratch_folder() as own:
        assert names(place) == sorted(["warprt-link", "warprt-live", "warprt-other", own.name])
        assert mode(own) == 0o700
        with scratch.scratch_folder() as second:
            assert own.is_dir()
            assert second != own
    live.release()
    assert names(place) == ["warprt-link", "warprt-live", "warprt-other"]


@pytest.mark.parametrize("kind", ["pipe", "link", "folder"])
def test_what_stands_in_place_of_the_temporary_file_is_left_alone(tmp_path, kind):
    place = tmp_path / ".x.part"
    {"pipe": os.mkfifo, "link": lambda path: path.symlink_to("victim"), "folder": Path.mkdir}[kind](place)
    put(tmp_path / "x")
    assert (tmp_path / "x").read_text() == "new"
    assert names(tmp_path) == [".x.part", "x"]


@pytest.mark.parametrize("length", [235, 236, 250, 255])
def test_names_may_be_as_long_as_the_system_takes(tmp_path, length):
    put(tmp_path / ("a" * length))
    assert names(tmp_path) == ["a" * length]


def test_work_kept_aside_follows_no_link(folder):
    """Anybody can make one in the folder for temporary files."""
    (folder / "precious").write_text("precious")
    kept = unfinished.Unfinished(folder / "none" / "x.npz", {"color": np.zeros((2, 2, 3))}, dict)
    kept._aside.symlink_to(folder / "precious")
    with pytest.raises(OSError, match="is a link, or not a file of yours"):
        kept.save()
    assert (folder / "precious").read_text() == "precious"
    kept._aside.unlink()
    assert kept.save() == kept._aside
