"""Randomly changed scenes: the program accepts or refuses them, and never crashes."""

from __future__ import annotations

import os
import random
import re

from tests.conftest import SMALL_SCENE

SEED = 20161121
SCENE = SMALL_SCENE + 8 * "! a comment, where most of what is changed does no harm\n"
COUNT = int(os.environ.get("ENTROSLIP_MUTATIONS", "100"))  # of each kind
FILES = {
    "s.nml": """\
&scene title = 'spoilt' seed = 3 /
&process correlation_length = 0.3 order = 1 mean = 0.3 std = 0.1 /
&structure mass_matrix = 'M.mtx' stiffness_matrix = 'K.mtx' damping_matrix = 'C.mtx'
  directions = 'W.mtx' joints = 'joints.txt' load = 'load.txt' /
&excitation variance = 2.0 /
&integration n_steps = 100 dt = 0.01 method = 'event' /
&campaign n_samples = 2 /
""",
    "M.mtx": """\
%%MatrixMarket matrix coordinate real symmetric
% mass [kg]
3 3 4
1 1 2.0
2 2 1.5
3 2 0.1
3 3 1.0
""",
    "K.mtx": """\
%%MatrixMarket matrix array real general
3 3
50
-25
0
-25
50.0
-25.0
0
-2.5e1
25d0
""",
    "C.mtx": """\
%%MatrixMarket matrix coordinate real symmetric
3 3 3
1 1 0.1
2 2 0.1
3 3 0.1
""",
    "W.mtx": """\
%%MatrixMarket matrix coordinate real general
3 2 3
1 1 1.0
1 2 0.6
3 2 -0.8
""",
    "joints.txt": """\
# stiffness normal_load friction friction_point
50.0 10.0 0.2 1
20.0 5.0 0.2 2
""",
    "load.txt": "0.0\n0.5\n# at the end\n1.0\n",
}
PIECES = [*"/&'=,()-*%!", "1e400", "nan", "-1", "0", "é"]
PLACE = re.compile(
    r"mutated\.nml(:\d+: .+|: must have &process, &chain or &structure|: is not plain text)"
)


def spoilt(text: str, dice: random.Random) -> str:
    """Text with one to three changes: characters replaced, removed, doubled or inserted."""
    for _ in range(dice.randint(1, 3)):
        first = dice.randrange(len(text))
        last = first + dice.randint(1, 12)
        change = dice.randrange(4)
        if change == 0:
            text = text[:first] + chr(dice.randrange(256)) + text[first + 1 :]
        elif change == 1:
            text = text[:first] + text[last:]
        elif change == 2:
            text = text[:last] + text[first:]
        else:
            text = text[:first] + dice.choice(PIECES) + text[first:]
    return text


def test_a_spoilt_scene_is_accepted_or_refused(entroslip, tmp_path):
    """Exit code 4 if it asks for a process that does not exist."""
    print(f"seed {SEED}")
    dice = random.Random(SEED)
    path = tmp_path / "mutated.nml"
    outcomes = {0: 0, 2: 0, 4: 0}
    for number in range(COUNT):
        text = spoilt(SCENE, dice)
        path.write_text(text, encoding="utf-8", newline="")
        done = entroslip("check", path, timeout=60)
        assert done.returncode in outcomes, f"{number}: {done.returncode}\n{text}\n{done.stderr}"
        outcomes[done.returncode] += 1
        if done.returncode == 2:
            assert PLACE.search(done.stderr), f"{number}:\n{text}\n{done.stderr}"
            if number % 10 == 0:
                assert entroslip("run", path, timeout=60).returncode == 2
        elif done.returncode == 4:
            assert "process 1: " in done.stderr, f"{number}:\n{text}\n{done.stderr}"
        assert [p.name for p in tmp_path.iterdir()] == ["mutated.nml"]
    assert min(outcomes[0], outcomes[2]) > COUNT / 20  # both ends were seen


def test_a_spoilt_structure_is_accepted_or_refused(entroslip, tmp_path):
    """Changes the scene or one of its files; a refusal names a file or the process."""
    print(f"seed {SEED}")
    dice = random.Random(SEED)
    outcomes = {0: 0, 2: 0, 4: 0}
    for number in range(COUNT):
        spoilt_name = dice.choice(list(FILES))
        for name, text in FILES.items():
            if name == spoilt_name:
                text = spoilt(text, dice)
            (tmp_path / name).write_text(text, encoding="utf-8", newline="")
        done = entroslip("check", tmp_path / "s.nml", timeout=60)
        what = f"{number}: {done.returncode}\n{(tmp_path / spoilt_name).read_text()}\n{done.stderr}"
        assert done.returncode in outcomes, what
        outcomes[done.returncode] += 1
        if done.returncode == 2:
            assert any(name in done.stderr for name in FILES), what
        elif done.returncode == 4:
            assert "process 1: " in done.stderr, what
        assert {p.name for p in tmp_path.iterdir()} == set(FILES)
    assert min(outcomes[0], outcomes[2]) > COUNT / 20
