"""Full disks, read-only folders and a folder that goes away, on small file systems of their own.

usage: check_disk_faults.py PROGRAM

The file systems are made in a mount namespace that ends with the test. Where even that is not
allowed the test is skipped (exit code 77).
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = sys.argv[1]
SKIPPED = 77


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    words = [PROGRAM, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=120)


def mount(options: str, folder: Path) -> None:
    subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], check=True)


def check_refused(done: subprocess.CompletedProcess[str], reason: str, place: Path) -> None:
    told = f"code {done.returncode}, stderr:\n{done.stderr}"
    assert done.returncode == 3, told
    assert reason in done.stderr, told
    assert str(place) in done.stderr, told
    assert len(done.stderr.strip().splitlines()) == 1, told


def check_full_while_shards_are_written(base: Path, kilobytes: int, deed: str = "fill") -> int:
    place = base / f"{deed}_{kilobytes}"
    place.mkdir()
    mount(f"size={kilobytes}k", place)
    check_refused(run(deed, place / "x.h5"), "No space left on device", place)
    if not (place / "x.h5.shards").exists():
        return 0
    left = [path.name for path in (place / "x.h5.shards").iterdir()]
    assert not [name for name in left if ".part" in name], left
    sound = run("verify", place / "x.h5")
    assert sound.returncode == 0, sound.stderr
    assert int(sound.stdout) == len(left)
    return len(left)


def check_full_while_results_are_written(base: Path, kilobytes: int) -> bool:
    place = base / f"results_{kilobytes}"
    place.mkdir()
    mount(f"size={kilobytes}k", place)
    done = run("results", base / "x.h5", place / "x.h5")
    if done.returncode == 0:
        assert [path.name for path in place.iterdir()] == ["x.h5"]
        return True
    check_refused(done, "No space left on device", place)
    assert not list(place.iterdir()), list(place.iterdir())
    return False


def check_read_only(base: Path) -> None:
    place = base / "read_only"
    place.mkdir()
    mount("ro", place)
    for deed in ("fill", "fill_processes"):
        check_refused(run(deed, place / "x.h5"), "Read-only file system", place)
    check_refused(run("results", base / "x.h5", place / "x.h5"), "Read-only file system", place)


def check_everything() -> None:
    base = Path(tempfile.mkdtemp())
    try:
        mount("size=64m", base)
        assert run("shards", base / "x.h5").returncode == 0
        # page by page: every write of a file meets the full disk once
        written = [check_full_while_shards_are_written(base, size) for size in range(4, 200, 4)]
        assert written[0] == 0, written
        assert written[-1] >= 2, written
        sizes = range(4, 60, 4)
        kept = [check_full_while_shards_are_written(base, size, "fill_processes") for size in sizes]
        assert kept[0] == 0, kept
        assert kept[-1] >= 2, kept
        finished = [check_full_while_results_are_written(base, size) for size in range(4, 320, 8)]
        assert not finished[0], finished
        assert finished[-1], finished
        assert finished == sorted(finished), finished
        check_read_only(base)
        shutil.rmtree(base / "x.h5.shards")
        missing = run("results", base / "x.h5", base / "y.h5")
        check_refused(missing, "lacks sample 1 of case 1", base)
        assert not list(base.glob("y.h5*"))
    finally:
        subprocess.run(["umount", "--recursive", base], check=False)
        os.rmdir(base)


def main() -> int:
    if len(sys.argv) > 2:
        check_everything()
        return 0
    inside = ["unshare", "--mount", *([] if os.geteuid() == 0 else ["--map-root-user"])]
    trial = [*inside, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    if not shutil.which("unshare") or subprocess.run(trial).returncode:
        print("skipped: no file system may be mounted here, not even in a namespace of its own")
        return SKIPPED
    return subprocess.run([*inside, sys.executable, *sys.argv, "inside"]).returncode


sys.exit(main())
